"""Cavity maps, and the sums that they are made of, beside plain numpy in double."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from exports.textures.patches import all_triangles, curved, grid_mesh
from rhytid.exports.textures import square_sums
from rhytid.exports.textures.frame_map import Chart
from rhytid.exports.textures.square_sums import Sums, with_square_sums
from rhytid.exports.textures.writers import cavity_codes

MESH, SIDE, DEPTH = grid_mesh(curved, 4), 96, 0.01


def summed(values: NDArray[np.float32], size: int) -> NDArray[np.float64]:
    """Each sum by itself."""
    around = np.pad(values.astype(np.float64), size // 2)
    windows = np.lib.stride_tricks.sliding_window_view(around, (size, size))
    return windows.sum(axis=(2, 3))


@pytest.mark.parametrize("size", [1, 3, 7, 33])
@pytest.mark.parametrize(("part", "step"), [(256, 16), (16, 16), (10, 3), (1, 1)])
def test_sums_are_those_of_each_square(
    size: int, part: int, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(square_sums, "_PART", part)
    monkeypatch.setattr(square_sums, "_STEP", step)
    values = np.random.default_rng(1).normal(0.0, 0.01, (40, 40)).astype(np.float32)
    found, times = np.full((40, 40), np.nan), np.zeros(40)

    def note(sums: Sums) -> None:
        first, rows = sums
        found[first : first + len(rows)] = rows
        times[first : first + len(rows)] += 1

    with_square_sums(values.__getitem__, 40, size, note)

    np.testing.assert_allclose(found, summed(values, size), rtol=0, atol=1e-13)
    assert (times == 1).all()


@pytest.mark.parametrize("whole", [False, True])
def test_codes_are_those_of_double(whole: bool) -> None:
    triangles = all_triangles(MESH, SIDE)
    triangles[:, :20] = len(MESH.faces)
    chart = Chart.of(MESH, 1001, triangles)
    if whole:
        every = np.ones((SIDE, SIDE), np.bool_)
        numbers = np.arange(SIDE * SIDE, dtype=np.int32).reshape(SIDE, SIDE)
        chart = replace(chart, covered=every, inside=every, nearest=numbers)
    heights = np.random.default_rng(2).normal(-0.1, DEPTH / 5, (SIDE, SIDE)).astype(np.float32)
    inside = chart.inside
    heights[~inside] -= DEPTH
    counts = np.maximum(summed(inside.astype(np.float32), chart.around), 0.5)
    mean = summed(heights * inside, chart.around) / counts
    values = 1.0 + np.clip((heights - mean) / DEPTH, -1.0, 0.0)
    wanted = np.where(chart.covered, chart.padded(values), 1.0)

    codes, least = cavity_codes(heights, chart, DEPTH)

    np.testing.assert_array_equal(codes, np.rint(255.0 * wanted))
    assert least == pytest.approx(wanted.min(), abs=1e-12)
    assert wanted.max() == 1.0
    assert 0 < (codes == 255).mean() < 0.9
