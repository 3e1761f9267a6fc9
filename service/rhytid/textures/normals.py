"""Tangent-space normal maps of displacement on a posed surface.

The normal of a surface P + h n is, to first order in h, along n - g, where g is the gradient of h
on the surface: g . dP/du = dh/du, g . dP/dv = dh/dv. A shader that reads the map computes x T + y B
+ z N, and B = sign (N x T), of N and T that are interpolated and not made unit vectors again, as
MikkTSpace asks for; (x, y, z) is what makes this parallel to n - g.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.textures.chart import TEXELS, Chart
from rhytid.textures.tangents import Posed, dot, unit

FloatArray = NDArray[np.float64]
# Weight of a neighbour outside of the islands: it counts where there is no other.
_OUTSIDE = 1e-9


def normal_map(heights: NDArray[np.float32], chart: Chart, posed: Posed) -> NDArray[np.float32]:
    """(R, R, 3) unit vectors (along u, along v, outwards) of a map (R, R), mesh units, row 0 at the
    top. In the padding those of the nearest texel inside, beyond it (0, 0, 1)."""
    side = len(heights)
    out = np.zeros((side, side, 3), np.float32)
    rows = max(TEXELS // side, 1)
    for start in range(0, side, rows):
        part = slice(start, min(start + rows, side))
        inside = chart.inside[part]
        found = chart.triangles[part][inside].astype(np.int64)
        if len(found):
            slopes = _slopes(heights, chart, part)[inside]
            weights = chart.corner_weights(part, inside)
            out[part][inside] = _normals(slopes, found, weights, posed)
    return np.where(chart.covered[..., None], chart.padded(out), np.array([0, 0, 1], np.float32))


def _normals(
    slopes: FloatArray, found: NDArray[np.int64], weights: FloatArray, posed: Posed
) -> FloatArray:
    """(K, 3) of texels in triangles `found`, with slopes (K, 2) = (dh/du, dh/dv)."""
    mean = np.einsum("kc,kcx->kx", weights, posed.normals[found])
    normal = unit(mean)
    tangent = np.einsum("kc,kcx->kx", weights, posed.tangents[found])
    sign = posed.signs[found][:, None]
    du, across_u, dv = posed.scale[found].T[..., None]
    # A triangle without area in space has no slopes: it is taken as flat.
    flat = (du <= 0.0) | (dv <= 0.0)
    along = np.where(flat, 0.0, slopes[:, :1] / np.where(flat, 1.0, du))
    across = np.where(flat, 0.0, (slopes[:, 1:] - across_u * along) / np.where(flat, 1.0, dv))
    # The axes of the triangle, turned into the plane of the interpolated normal.
    first = unit(posed.along[found] - dot(posed.along[found], normal) * normal)
    second = sign * np.cross(normal, first)
    wanted = normal - along * first - across * second
    return _in_frame(wanted, mean, tangent, sign * np.cross(mean, tangent))


def _in_frame(
    wanted: FloatArray, normal: FloatArray, tangent: FloatArray, bitangent: FloatArray
) -> FloatArray:
    """Unit (x, y, z) with x T + y B + z N along `wanted`; T need not be orthogonal to N, nor any of
    them of length 1."""
    size = np.maximum(dot(normal, normal), 1e-300)
    lean = dot(tangent, normal) / size
    flat = tangent - lean * normal
    x = dot(wanted, flat) / np.maximum(dot(flat, flat), 1e-300)
    y = dot(wanted, bitangent) / np.maximum(dot(bitangent, bitangent), 1e-300)
    return unit(np.concatenate([x, y, dot(wanted, normal) / size - x * lean], axis=1))


def _slopes(heights: NDArray[np.float32], chart: Chart, rows: slice) -> FloatArray:
    """(rows, R, 2) of dh/du and dh/dv: differences over two texels, over one where a neighbour is
    outside, of another island or beyond the border."""
    side = len(heights)
    index = np.arange(side)
    here = index[rows]
    offset = max(rows.start - 1, 0)
    near = slice(offset, rows.stop + 1)
    island = chart.islands[chart.triangles[near]]
    trust = np.where(chart.inside[near], 1.0, _OUTSIDE)

    def step(
        row: NDArray[np.int64], column: NDArray[np.int64]
    ) -> tuple[FloatArray, NDArray[np.float64]]:
        """How much higher the neighbours are, and their distance in texels: 0 where not used."""
        same = island[np.ix_(row - offset, column)] == island[np.ix_(here - offset, index)]
        higher = heights[np.ix_(row, column)].astype(np.float64) - heights[rows]
        moved = (row != here)[:, None] | (column != index)[None]
        used = (same & moved) * trust[np.ix_(row - offset, column)]
        return higher * used, used

    right, left = np.minimum(index + 1, side - 1), np.maximum(index - 1, 0)
    below, above = np.minimum(here + 1, side - 1), np.maximum(here - 1, 0)
    slopes = []
    for plus, minus in (((here, right), (here, left)), ((above, index), (below, index))):
        (rise, more), (fall, less) = step(*plus), step(*minus)
        slopes.append((rise - fall) * side / np.maximum(more + less, 1e-3 * _OUTSIDE))
    return np.stack(slopes, axis=-1)
