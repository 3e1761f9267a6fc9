"""Crops of a displacement map as they are on the surface, at true scale."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.flat_patches import FlatPatch


def surface_crop(
    displacement: NDArray[Any], patch: FlatPatch, side: float, pixels: int, deformed: bool
) -> NDArray[np.float64]:
    """(pixels, pixels) heights on a square of `side` mesh units around a patch.

    displacement: (R, R), row 0 at the top.  deformed: measure `side` on the deformed surface, so
    that stretched skin shows less of the map.  The spacing is side / pixels.
    """
    along = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side
    x, y = np.meshgrid(along, -along)
    to_uv = patch.to_uv @ np.linalg.inv(patch.shape) if deformed else patch.to_uv
    u, v = (patch.uv[i] + to_uv[i, 0] * x + to_uv[i, 1] * y for i in (0, 1))
    size = len(displacement)
    return spline_samples(displacement, (1 - v) * size - 0.5, u * size - 0.5)


def spline_samples(
    values: NDArray[Any], row: NDArray[np.float64], column: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cubic B-spline over (H, W) at fractional positions; the border is repeated.

    Twice differentiable, so that shading shows neither texels nor facets. It does not pass through
    the texels: it smooths by about half a texel (its variance is 1/3 texel²).
    """
    r, c = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    return _weighted(values, r, c, _weights(row - r), _weights(column - c))


def spline_slopes(
    values: NDArray[Any], row: NDArray[np.float64], column: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The derivatives of `spline_samples` by row and by column, per texel."""
    r, c = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    down = _weighted(values, r, c, _slopes(row - r), _weights(column - c))
    return down, _weighted(values, r, c, _weights(row - r), _slopes(column - c))


def _weighted(
    values: NDArray[Any],
    r: NDArray[np.int64],
    c: NDArray[np.int64],
    by_row: list[NDArray[np.float64]],
    by_column: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Sums over 4 x 4 texels from (r - 1, c - 1) on; the border is repeated."""
    result = np.zeros(r.shape)
    for i in range(4):
        y = np.clip(r + i - 1, 0, values.shape[0] - 1)
        for j in range(4):
            x = np.clip(c + j - 1, 0, values.shape[1] - 1)
            result += by_row[i] * by_column[j] * values[y, x]
    return result


def _weights(t: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [
        (1 - t) ** 3 / 6,
        (4 + t * t * (3 * t - 6)) / 6,
        (1 + t * (3 + t * (3 - 3 * t))) / 6,
        t**3 / 6,
    ]


def _slopes(t: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Derivatives of the weights."""
    return [-((1 - t) ** 2) / 2, t * (3 * t - 4) / 2, (1 + t * (2 - 3 * t)) / 2, t * t / 2]
