"""Maps at another resolution, against sums and cubics that are worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.scan import resampled

NOISE = np.random.default_rng(0).normal(0, 1, (48, 60)).astype(np.float32)


def test_the_same_size_is_the_same_map() -> None:
    assert np.array_equal(resampled(NOISE, 48, 60), NOISE)


def test_by_area_each_texel_is_the_mean_of_its_own() -> None:
    found = resampled(NOISE, 16, 15)
    wanted = NOISE.astype(np.float64).reshape(16, 3, 15, 4).mean(axis=(1, 3))
    assert found == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("size", [(47, 59), (31, 7), (1, 1), (20, 60), (48, 33)])
def test_by_area_any_ratio_keeps_the_mean(size: tuple[int, int]) -> None:
    found = resampled(NOISE + 100, *size)
    assert found.shape == size
    assert found.mean(dtype=np.float64) == pytest.approx(float(NOISE.mean()) + 100, abs=1e-5)


def test_by_area_shares_of_texels_count() -> None:
    """Three texels become two: a third of the middle one and two of an outer one in each."""
    row = np.array([[3.0, 6.0, 30.0]], np.float32)
    assert resampled(row, 1, 2)[0] == pytest.approx([4.0, 22.0])


def test_cubic_passes_through_texels_and_follows_squares() -> None:
    """Three times as many: the middle one of each three lies on a texel."""
    found = resampled(NOISE, 144, 180)
    assert found[1::3, 1::3] == pytest.approx(NOISE, abs=1e-6)
    place = np.arange(12.0)
    square = np.broadcast_to(place**2, (5, 12)).astype(np.float32)
    fine = resampled(square, 5, 48)[0]
    wanted = ((np.arange(48) + 0.5) / 4 - 0.5) ** 2
    assert fine[6:-6] == pytest.approx(wanted[6:-6], abs=1e-4)


def test_cubic_overshoots_an_edge_by_no_more_than_is_said() -> None:
    edge = np.repeat([0.0, 1.0], 8)[None].astype(np.float32)
    fine = resampled(edge, 1, 160)
    assert 1.03 < fine.max() < 1.075
    assert fine[0, 0] == 0.0
    assert fine[0, -1] == 1.0


def test_constant_maps_stay() -> None:
    for size in ((100, 100), (7, 7), (7, 100)):
        assert np.array_equal(
            resampled(np.full((48, 60), 0.7, np.float32), *size), np.full(size, np.float32(0.7))
        )


def test_half_floats_and_codes_become_floats() -> None:
    assert resampled(NOISE.astype(np.float16), 24, 30).dtype == np.float32
