"""Levels: means of 2 x 2 texels, whatever the cut."""

from __future__ import annotations

import numpy as np
import pytest

from reference import pyramid
from rhytid.pipeline import levels
from rhytid.pipeline.levels import render, render_to_host
from rhytid.pipeline.vectors import VECTOR

RESOLUTION = 512
MAP = np.random.default_rng(1).normal(size=(RESOLUTION, RESOLUTION)).astype(np.float32)


@pytest.fixture
def draw(device):
    """Level 0 as it is drawn: crops of a map of noise."""

    def crop(row, column, side):
        assert max(row, column) + side <= RESOLUTION
        return device.upload(MAP[row : row + side, column : column + side])

    return crop


def whole(device, draw, level):
    return render_to_host(device, draw, level, 0, 0, RESOLUTION >> level)


@pytest.mark.parametrize("level", range(10))
def test_a_level_is_that_of_double(device, draw, level):
    wanted = pyramid.levels(MAP)[level]
    np.testing.assert_allclose(whole(device, draw, level), wanted, atol=1e-6 * np.abs(MAP).max())


@pytest.mark.parametrize("level", range(10))
def test_any_chunk_gives_the_same_bits(device, draw, level, monkeypatch):
    plain = whole(device, draw, level)
    for chunk in (256, 64):
        monkeypatch.setattr(levels, "_CHUNK", chunk)
        np.testing.assert_array_equal(whole(device, draw, level), plain)
        side = RESOLUTION >> level
        buffer = render(device, draw, level, 0, 0, side)
        np.testing.assert_array_equal(device.read(buffer, (side, side), np.float32), plain)
        buffer.release()


@pytest.mark.parametrize("level", [0, 1, 3])
def test_a_crop_of_a_level_is_the_same_bits(device, draw, level):
    plain = whole(device, draw, level)
    side = 64 >> level
    crop = render_to_host(device, draw, level, 2 * side, 5 * side, side)
    np.testing.assert_array_equal(crop, plain[2 * side : 3 * side, 5 * side : 6 * side])


def test_nothing_is_left_on_the_device(device, draw, monkeypatch):
    used = device.budget.used
    for chunk in (4096, 64):
        monkeypatch.setattr(levels, "_CHUNK", chunk)
        for level in (0, 2, 9):
            whole(device, draw, level)
    assert device.budget.used == used


def test_a_level_drawn_in_pieces_has_room_for_a_vector(device, monkeypatch):
    def draw(row, column, side):
        return device.full(side * side, np.float32(3.0))

    monkeypatch.setattr(levels, "_CHUNK", 64)
    for side in (1, 2):
        found = levels.render(device, draw, 6, 0, 0, side)
        assert found.nbytes >= 4 * VECTOR
        np.testing.assert_array_equal(device.read(found, (side, side), np.float32), 3.0)
