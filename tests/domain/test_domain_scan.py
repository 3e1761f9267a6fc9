"""What values of scanned displacement stand for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rhytid.domain.scan import Scan, ScanMap, ScanSettings, heights
from rhytid.errors import SettingsError

BAND = np.array([[0, 65535], [32768, 13107]], np.uint16)


def scan(*channels: np.ndarray, scales: tuple[float, ...], midlevel: float) -> Scan:
    map = ScanMap(1001, "d.1001.png", channels)
    return Scan({1001: map}, scales, {1001: (midlevel,) * len(channels)})


def test_a_relief_is_the_sum_of_its_bands() -> None:
    one = scan(BAND, BAND.T.copy(), 0 * BAND, scales=(2.0, -1.0, 4.0), midlevel=0.5)
    values = BAND / 65535 - 0.5
    assert one.relief(1001) == pytest.approx(2 * values - values.T - 2.0, abs=1e-6)
    assert [band.dtype for band in one.bands(1001)] == [np.float32] * 3
    assert one.step(1001, 2) == pytest.approx(4 / 65535)


def test_floats_of_mesh_units_stay_bit_for_bit() -> None:
    for dtype in (np.float16, np.float32):
        noise = np.random.default_rng(1).normal(0, 1e-3, (64, 64)).astype(dtype)
        found = heights(noise, 1.0, 0.0)
        np.testing.assert_array_equal(found, noise.astype(np.float32), strict=True)
        assert scan(noise, scales=(1.0,), midlevel=0.0).step(1001) == 0.0


def test_heights_are_within_half_a_step_of_16_bits_of_what_they_stand_for() -> None:
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    found = heights(codes, 3.0, 0.25).astype(np.float64)
    assert np.abs(found - 3.0 * (codes / 65535 - 0.25)).max() < 0.01 * 3.0 / 65535


def test_a_map_is_turned_over() -> None:
    map = ScanMap(1001, "d", (BAND,))
    for flip, wanted in (("v", BAND[::-1]), ("u", BAND[:, ::-1]), ("uv", BAND[::-1, ::-1])):
        assert np.array_equal(map.flipped(flip).channels[0], wanted)
    assert np.array_equal(map.flipped(None).channels[0], BAND)


def test_a_relief_comes_at_any_resolution() -> None:
    one = scan(BAND, scales=(1.0,), midlevel=0.0)
    assert one.relief(1001, 1) == pytest.approx(BAND.mean() / 65535)
    assert one.relief(1001, 64).shape == (64, 64)


@pytest.mark.parametrize(
    ("given", "unit", "wanted"),
    [
        ({"scale": (2.0,)}, "cm", 2.0),
        ({"scale": (2.0,), "unit": "mm"}, "cm", 0.2),
        ({"scale": (2.0,), "unit": "mm"}, "5.5cm", 2.0 / 55.0),
        ({"scale": (-1.0,), "unit": "in"}, "mm", -25.4),
        ({"scale": (2.0,), "unit": "head"}, "head", None),
    ],
)
def test_scales_are_in_mesh_units(given: dict[str, Any], unit: str, wanted: float | None) -> None:
    if wanted is None:
        with pytest.raises(SettingsError, match=r"scan\.unit is 'head': one of um"):
            ScanSettings(**given)
    else:
        assert ScanSettings(**given).scales(1, True, unit, "d") == pytest.approx((wanted,))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"scale": (0.0,)}, "scan.scale is 0: that is no relief"),
        ({"scale": (0.0, 0.0, 0.0)}, "scan.scale is 0: that is no relief"),
        ({"scale": (1.0, 2.0)}, "scan.scale has 2 numbers: one, or one for each of 3 bands"),
        ({"scale": (1.0, float("inf"), 1.0)}, "scan.scale is 1, inf, 1: must be finite"),
        ({"flip": "w"}, "scan.flip is 'w': one of v, u, uv"),
        ({"midlevel": "grey"}, "scan.midlevel is 'grey': a number, or 'auto'"),
        ({"midlevel": float("nan")}, "scan.midlevel is nan: must be finite"),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        ScanSettings(**given)


def test_scales_are_those_of_the_map() -> None:
    for given, channels, coded, said in (
        (ScanSettings(), 1, True, "must be given; where nobody knows it, try one"),
        (ScanSettings((1.0, 1.0, 1.0)), 1, False, "d has one channel, scan.scale has 3 numbers"),
        (ScanSettings((1.0,)), 3, True, "d has three channels that differ: give scan.scale"),
        (ScanSettings(), 3, False, "d has three channels that differ: give scan.scale"),
        (ScanSettings((1.0,), unit="mm"), 1, True, "the unit of the mesh, 'head', has no known"),
    ):
        with pytest.raises(SettingsError, match=said):
            given.scales(channels, coded, "head", "d")
    assert ScanSettings((0.0, 1.0, 2.0)).scales(3, True, "cm", "d") == (0.0, 1.0, 2.0)
    assert ScanSettings().scales(1, False, "cm", "d") == (1.0,)
