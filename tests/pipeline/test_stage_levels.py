"""Levels: means of 2 x 2 texels, whatever the cut."""

from __future__ import annotations

import numpy as np
import pytest

from reference import pyramid
from rhytid.pipeline import levels
from rhytid.pipeline.levels import Part, coarser, render_to_host

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


@pytest.mark.parametrize("side", [64, 128, RESOLUTION])
def test_the_levels_of_a_square_are_the_same_bits_whatever_its_parts(device, draw, side):
    wanted = [whole(device, draw, level) for level in range(1, 10)]
    places = [(y, x) for y in range(0, RESOLUTION, side) for x in range(0, RESOLUTION, side)]
    parts = [Part(*place, side, draw(*place, side)) for place in places]
    found = coarser(device, parts, RESOLUTION, 9)
    assert found.side == RESOLUTION // 2
    for buffer, level in zip(found.buffers, wanted, strict=True):
        np.testing.assert_array_equal(device.read(buffer, level.shape, np.float32), level)
    assert found.nbytes == sum(level.nbytes for level in wanted)
    for held in (found, *(part.buffer for part in parts)):
        held.release()
