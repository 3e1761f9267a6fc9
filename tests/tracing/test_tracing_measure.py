"""How a relief is measured: its fine part, how deep it is, and parts of maps."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from rhytid.synthesis.workspace import Workspace
from rhytid.tracing import measure

SHAPE = (70, 45)


def mean_around(values, side, mode):
    """The mean over a square, twice, of a map that goes on beyond its border."""
    found = np.pad(values.astype(np.float64), side, mode)
    for _ in range(2):
        found = scipy.ndimage.uniform_filter(found, side)
    return found[side:-side, side:-side]


@pytest.mark.parametrize("tile", [32, 1024])
def test_the_fine_part_of_a_chart_in_tiles(device, monkeypatch, tile):
    """Of a map whose sides are no multiples of vectors or tiles, about 5."""
    monkeypatch.setattr(measure, "_TILE", tile)
    rng = np.random.default_rng(2)
    relief = (rng.normal(size=SHAPE) + 5.0).astype(np.float32)
    inside = np.hypot(*np.ogrid[-30:40, -20:25]) < 24
    share = mean_around(inside, measure.BROAD, "constant")
    broad = mean_around(relief * inside, measure.BROAD, "constant") / np.maximum(share, 1e-6)
    with Workspace(device) as work:
        found = measure.fine_part(work, relief, inside)
        above = measure.above_mean(work, relief, measure.NARROW)
    np.testing.assert_allclose(found, np.where(inside, relief - broad, 0.0), atol=2e-5)
    wanted = relief - mean_around(relief, measure.NARROW, "edge")
    np.testing.assert_allclose(above, wanted, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 999, 1002])
def test_the_depth_is_a_quantile(count):
    fine = np.random.default_rng(count).normal(size=(2, count)).astype(np.float32)
    inside = np.zeros((2, count), np.bool_)
    inside[1] = True
    wanted = max(float(np.quantile(-fine[1].astype(np.float64), 0.999)), 0.0)
    assert measure.depth_of(fine, inside) == pytest.approx(wanted, rel=1e-6)
    assert measure.depth_of(fine, ~inside & inside) == 0.0


@pytest.mark.parametrize("corner", [(2, 3), (-4, 1), (5, -3), (-2, -2), (9, 0), (0, -11)])
def test_parts_of_maps_within_at_and_beyond_borders(corner):
    values = np.arange(1.0, 57.0, dtype=np.float32).reshape(7, 8)
    wide = np.pad(values, 20)
    row, column = (20 + at for at in corner)
    found = measure.cut_out(values, corner, (6, 5))
    np.testing.assert_array_equal(found, wide[row : row + 6, column : column + 5])
    assert found.flags.c_contiguous
