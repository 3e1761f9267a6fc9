"""Grain below the texels of a scan: what these see of it, and how high it is."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.residual import ScanRelief
from rhytid.domain.scan import resampled
from rhytid.domain.spectra import band_squares
from rhytid.errors import InputError
from rhytid.pipeline.grain import GrainPlanes, grain_amplitude, grain_codes, relief_shares
from rhytid.pipeline.locate import UdimTriangles
from rhytid.tracing.detail import seen, texels_with_means
from rhytid.tracing.scan import traced_scan
from rhytid.tracing.trace import traced_settings
from synthesis.sheets import sheet

SIDE, OWN = 512, 256


def means(map: np.ndarray, side: int) -> np.ndarray:
    """Over squares of texels, in double."""
    step = len(map) // side
    return map.astype(np.float64).reshape(side, step, side, step).mean(axis=(1, 3))


def noise(side: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(side, side)).astype(np.float32)


def test_texels_with_means_a_scan_that_was_made_larger_are_its_own() -> None:
    for side, size in ((64, 256), (48, 256), (100, 128)):
        own = noise(side)
        assert texels_with_means(resampled(own, size, size), side) == pytest.approx(own, abs=2e-5)


def test_what_is_seen_of_grain_has_its_means() -> None:
    grain = noise(256)
    left = grain - seen(grain, 64)
    assert np.abs(means(left, 64)).max() < 2e-6
    assert np.abs(means(grain, 64)).max() > 0.5
    assert left.std() > 0.9


def fractal(side: int) -> np.ndarray:
    """Waves half as high as those twice as long, as fine lines of skin are: 2 in 3 of what is left
    at two texels."""
    waves = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side))
    waves[0, 0] = np.inf
    return np.fft.ifft2(np.fft.fft2(noise(side)) * waves**-1.6).real.astype(np.float32)


@pytest.fixture(scope="module")
def made(device):
    """A relief, twice as rough on the right, whose halves of texels are traced with detail of 1;
    what is drawn at rest, and the settings."""
    truth = 0.0004 * fractal(SIDE) * np.where(np.arange(SIDE) < SIDE // 2, 1, 2).astype(np.float32)
    larger = resampled(resampled(truth, OWN, OWN), SIDE, SIDE)
    scan, mesh = ScanRelief({1001: larger}, 0.0, {1001: OWN}, 1.0), sheet(scale=20.0)
    settings = AssetSettings.parse({"unit": "mm", "resolution": SIDE})
    found = traced_scan(device, mesh, scan, settings)
    drawn = traced_settings(settings, detailed=True)
    drawn = drawn.with_lengths(found.graph.origin.lengths("mm", 0.5))
    shares = relief_shares(mesh, found.graph, found.graph.node_triangle)
    with device.task():
        located = UdimTriangles(device, mesh, 1001, SIDE, drawn.padding)
        planes = GrainPlanes(device, mesh, drawn, shares)
        codes = grain_codes(device, planes, located, drawn, (0, 0, SIDE))
        grain = grain_amplitude(drawn) * device.read(codes, (SIDE, SIDE), np.int8).astype(float)
    without = traced_scan(device, mesh, ScanRelief({1001: larger}), settings)
    lines = larger - without.residual[1001]
    grain *= np.clip(1 + lines / drawn.depth, 0.25, 1)
    return truth, larger, lines + grain + found.residual[1001], found


def test_means_over_texels_with_means_the_scan_stay(made):
    _, larger, rest, _ = made
    apart = np.abs(means(rest - larger, OWN))
    assert apart.max() < 0.5 / 65535 * np.ptp(larger)
    assert (rest - larger).std() > 1000 * apart.max()


def test_the_spectrum_goes_on_by_place(made):
    """The octave below the texels of the scan, left and right, of which next to nothing was there;
    that above is as it was."""
    truth, larger, rest, found = made
    heights = []
    for map in (truth, larger, rest):
        squares, known = band_squares(map, found.charts[1001], [(2.0, 4.0), (4.0, 8.0)])
        heights.append([[np.sqrt(s[:, h][known[:, h]].mean()) for s in squares] for h in HALVES])
    wanted, before, after = np.array(heights)
    assert (before[:, 0] < 0.4 * wanted[:, 0]).all()
    assert after[:, 0] == pytest.approx(wanted[:, 0], rel=0.35)
    assert after[:, 1] == pytest.approx(before[:, 1], rel=0.05)


HALVES = slice(0, 7), slice(9, 16)


def test_a_scan_that_is_masked_out_is_refused(device):
    settings = AssetSettings.parse({"unit": "mm", "resolution": OWN, "depth": 0.1})
    denied = {1001: np.ones((8, 8), np.uint8)}
    with pytest.raises(InputError, match="masked out throughout"):
        traced_scan(device, sheet(), ScanRelief({1001: fractal(OWN)}, denied=denied), settings)


def test_without_detail_nothing_is_added(device, made):
    _, larger, _, found = made
    assert found.graph.node_grain.max() > 0.2
    settings = AssetSettings.parse({"unit": "mm", "resolution": SIDE})
    plain = traced_scan(device, sheet(scale=20.0), ScanRelief({1001: larger}), settings)
    assert plain.graph.node_grain is None
    assert traced_settings(settings).shape.grain == 0.0
