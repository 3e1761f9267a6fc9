"""Spectra of reliefs, against transforms written out in double."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rhytid.domain.scan import resampled
from rhytid.domain.spectra import band_squares, shortest_wave

EVERYWHERE = np.ones((256, 256), np.bool_)


def fractal(slope: float, seed: int = 0) -> np.ndarray:
    """(256, 256) noise whose density falls with the number of waves to the power `slope`."""
    waves = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256))
    waves[0, 0] = np.inf
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(256, 256)))
    return np.fft.ifft2(white * waves ** (slope / 2)).real


def test_a_band_has_the_squares_of_its_terms() -> None:
    """Of one block, and the sum of all bands is the variance of what lies under the window."""
    map = fractal(-2.0)[:32, :32]
    at = np.arange(32)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * at / 32)
    weight = window[:, None] * window
    under = (map - map.mean()) * weight
    turn = np.exp(-2j * np.pi * np.outer(at, at) / 32)
    squares = np.abs(turn @ under @ turn) ** 2 / 32**4 / np.mean(weight**2)
    along = np.minimum(at, 32 - at)
    waves = np.hypot(along[:, None], along)
    found, known = band_squares(map, EVERYWHERE[:32, :32], [(2.0, 4.0), (4.0, 9.0), (1.0, 1e9)])
    assert known.tolist() == [[True]]
    assert found[0, 0, 0] == pytest.approx(squares[(waves > 8) & (waves <= 16)].sum())
    assert found[1, 0, 0] == pytest.approx(squares[(waves > 32 / 9) & (waves <= 8)].sum())
    whole = np.mean(under**2) / np.mean(weight**2)
    assert found[2, 0, 0] + squares[0, 0] == pytest.approx(whole)


def test_blocks_that_are_not_inside_are_left_out() -> None:
    inside = EVERYWHERE.copy()
    inside[40, 70] = False
    map = fractal(-2.0)
    map[40, 70] = np.nan
    found, known = band_squares(map, inside, [(2.0, 4.0)])
    assert np.argwhere(~known).tolist() == [[1, 2]]
    assert found[0, 1, 2] == 0.0
    assert np.isfinite(found).all()


@pytest.mark.parametrize("slope", [0.0, -3.0, -4.5])
def test_a_sharp_map_goes_on_to_its_texels(slope: float) -> None:
    assert shortest_wave(fractal(slope), EVERYWHERE) is None


def test_a_map_that_was_blurred_or_made_larger_ends_before() -> None:
    """A blur of s texels makes the power of the density less by 2 (2 pi s / wave)^2: by 4, from -3
    to -7, where waves are 4.44 s long."""
    sharp = fractal(-3.0)
    for blur in (1.0, 2.0):
        found = shortest_wave(gaussian_filter(sharp, blur, mode="wrap"), EVERYWHERE)
        assert found == pytest.approx(4.44 * blur, rel=0.2)
    larger = resampled(sharp[:64, :64], 256, 256)
    assert shortest_wave(larger, EVERYWHERE) == pytest.approx(8.0, rel=0.35)
    blurred = gaussian_filter(sharp, 2.0, mode="wrap")
    codes = np.rint(128 + 30 * blurred / blurred.std()).astype(np.uint8)
    assert shortest_wave(codes, EVERYWHERE) == pytest.approx(8.9, rel=0.2)


def test_of_nothing_no_end_is_known() -> None:
    assert shortest_wave(np.zeros((256, 256)), EVERYWHERE) is None
    assert shortest_wave(fractal(-3.0), ~EVERYWHERE) is None
    assert shortest_wave(fractal(-3.0)[:40], EVERYWHERE[:40]) is None
