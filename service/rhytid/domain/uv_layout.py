"""Quality of a UV layout: which part more than one triangle covers, and how large texels are on the
surface.

Overlaps are counted at the points of a grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import triangles_inside
from rhytid.domain.warnings import TEXEL_PLACE, TEXEL_RATIO, TEXEL_TAIL

# Points per side of a grid; 1 % of a UDIM is 2,600 of them.
SIDE = 512
# Rows of triangles that are checked together: bounds the memory.
_ROWS = 1 << 20
# Rows of all triangles: a layout of many large triangles is checked on a coarser grid.
_MOST_ROWS = 1 << 22
_BLOCK = 16
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Span = tuple[IntArray, IntArray, IntArray, IntArray]


@dataclass(frozen=True)
class Overlap:
    """Where triangles overlap in UV.

    share: of the covered area that two or more triangles cover.  uv: the middle of the place with
    most of it.  most: largest number of triangles that cover one point.
    """

    share: float
    uv: tuple[float, float]
    most: int


def overlap_of(corners: NDArray[np.float64]) -> Overlap | None:
    """The overlap of triangles (F, 3, 2) in the unit square, where they are clipped; None without
    any.

    Each row of points cuts a triangle in one span; spans are counted by their ends. Triangles that
    share an edge share its crossing to the last bit, so that no point is counted twice for them.
    """
    side = _grid_side(corners)
    counts = _counts(corners * side - 0.5, side)
    covered = int((counts > 0).sum())
    double = counts > 1
    if not covered or not double.any():
        return None
    blocks = double.reshape(side // _BLOCK, _BLOCK, side // _BLOCK, _BLOCK).sum(axis=(1, 3))
    row, column = np.unravel_index(int(blocks.argmax()), blocks.shape)
    u, v = ((index + 0.5) * _BLOCK / side for index in (column, row))
    return Overlap(float(double.sum()) / covered, (float(u), float(v)), int(counts.max()))


def overlapping(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(F,) whether a triangle of `overlap_of` lies over or under another at a point of its grid."""
    side = _grid_side(corners)
    scaled = corners * side - 0.5
    double = _counts(scaled, side) > 1
    # Sums along rows: a span has a double point where its ends differ.
    before = np.zeros((side, side + 1), np.int64)
    np.cumsum(double, axis=1, out=before[:, 1:])
    found = np.zeros(len(corners), bool)
    for part, triangle, row, first, last in _spans(scaled, side):
        hit = before[row, last] > before[row, first]
        found[part.start + triangle[hit]] = True
    return found


def coverage(corners: NDArray[np.float64], side: int) -> NDArray[np.bool_]:
    """(side, side) whether a triangle (F, 3, 2) of the unit square lies over the middle of a cell
    of a grid, row 0 at the top."""
    covered: NDArray[np.bool_] = _counts(corners * side - 0.5, side)[::-1] > 0
    return covered


@dataclass(frozen=True)
class TexelSpread:
    """Sides of texels on the surface, mesh units: the least, the usual and the most, without tails.

    coarse: whether the most is farther from the usual than the least is.  worst: the triangle that
    is largest in space of those that are farthest from the usual.  more: number of further places
    beyond TEXEL_RATIO, each of triangles that touch one another and of TEXEL_PLACE of the area or
    more.
    """

    least: float
    usual: float
    most: float
    coarse: bool
    worst: int
    more: int


def texel_spread(
    area: FloatArray, area_uv: FloatArray, faces: NDArray[np.int32], resolution: int
) -> TexelSpread | None:
    """The spread of triangles (F, 3) with areas (F,) in space and in UV; None where no texel is too
    large or too small."""
    side = texel_sides(area, area_uv, resolution)
    least, usual, most = side[texel_extremes(side, area)].tolist()
    if most <= TEXEL_RATIO * least:
        return None
    # Seen from the usual texel: what is farther off, skin that is too coarse or too fine.
    coarse = most / usual >= usual / least
    farthest = side >= most if coarse else side <= least
    worst = int(np.argmax(np.where(farthest, area, -1.0)))
    beyond = side > TEXEL_RATIO * least if coarse else side < most / TEXEL_RATIO
    beyond[worst] = True
    chosen = np.flatnonzero(beyond)
    place = _connected_places(faces[chosen])
    sizes = np.bincount(place, weights=area[chosen])
    sizes[place[np.searchsorted(chosen, worst)]] = 0.0
    more = int(np.count_nonzero(sizes >= TEXEL_PLACE * area.sum()))
    return TexelSpread(least, usual, most, coarse, worst, more)


def texel_sides(area: FloatArray, area_uv: FloatArray, resolution: int) -> FloatArray:
    """(F,) sides of texels on the surface, mesh units, in triangles of these areas."""
    sides: FloatArray = np.sqrt(area / area_uv) / resolution
    return sides


def texel_extremes(side: FloatArray, area: FloatArray) -> NDArray[np.intp]:
    """(3,) the triangles with the least, the median and the largest of sides (F,), weighted by area
    (F,), without TEXEL_TAIL of the area at either end."""
    order = np.argsort(side)
    shares = np.cumsum(area[order])
    tails = np.array([TEXEL_TAIL, 0.5, 1.0 - TEXEL_TAIL])
    found: NDArray[np.intp] = order[np.searchsorted(shares, tails * shares[-1])]
    return found


def mean_uv_length(mesh: Mesh, udim: int) -> float:
    """Mesh units that a step of 1 in UV is long in a UDIM: the root of its area in space over that
    in UV."""
    inside = triangles_inside(mesh, udim)
    area = _area(mesh.positions[mesh.faces[inside]].astype(np.float64))
    area_uv = _area(np.pad(mesh.triangle_uv()[inside], ((0, 0), (0, 0), (0, 1))))
    return float(np.sqrt(area / area_uv))


def _area(corners: FloatArray) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def usual_uv_length(mesh: Mesh) -> float:
    """Mesh units that a step of 1 in UV is long in its longest direction: the median over the area
    in space."""
    used = mesh.usable_triangles()
    a, b, c = np.moveaxis(mesh.positions[mesh.faces[used]].astype(np.float64), 1, 0)
    uv = mesh.triangle_uv()[used]
    edges, edges_uv = np.stack([b - a, c - a], axis=2), np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2)
    jacobian = edges @ np.linalg.inv(edges_uv)
    (e, f), (_, g) = np.moveaxis(np.swapaxes(jacobian, 1, 2) @ jacobian, 0, 2)
    longest = np.sqrt((e + g) / 2 + np.hypot((e - g) / 2, f))
    order = np.argsort(longest)
    shares = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1)[order])
    return float(longest[order[np.searchsorted(shares, 0.5 * shares[-1])]])


def _connected_places(faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """(F,) the lowest number of a vertex that each triangle hangs together with."""
    label = np.arange(int(faces.max()) + 1)
    while True:
        least = label[faces].min(axis=1)
        lower = label.copy()
        np.minimum.at(lower, faces, least[:, None])
        lower = lower[lower]
        if np.array_equal(lower, label):
            return label[faces[:, 0]]
        label = lower


def _grid_side(corners: NDArray[np.float64]) -> int:
    a, b, c = np.clip(corners[..., 1].T, 0.0, 1.0)
    heights = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
    height = float(heights.sum())
    side = SIDE
    while side > 2 * _BLOCK and height * side > _MOST_ROWS:
        side //= 2
    return side


def _counts(corners: NDArray[np.float64], side: int) -> NDArray[np.int64]:
    """(side, side) triangles over each point; corners (F, 3, 2) in units of the grid."""
    steps = np.zeros(side * (side + 1), np.int64)
    for _, _, row, first, last in _spans(corners, side):
        # Add 1 where a span begins and take it where one ends.
        for column, sign in ((first, 1), (last, -1)):
            steps += sign * np.bincount(row * (side + 1) + column, minlength=len(steps))
    counts: NDArray[np.int64] = np.cumsum(steps.reshape(side, side + 1), axis=1)[:, :side]
    return counts


def _spans(
    corners: NDArray[np.float64], side: int
) -> Iterator[tuple[slice, IntArray, IntArray, IntArray, IntArray]]:
    """Some triangles at a time: which, and (N,) of their spans the triangle among these, the row,
    the first column and the one after the last."""
    corners = np.take_along_axis(corners, np.argsort(corners[..., 1], axis=1)[..., None], axis=1)
    first = np.clip(np.ceil(corners[:, 0, 1]), 0, side).astype(np.int64)
    rows = np.clip(np.ceil(corners[:, 2, 1]), 0, side).astype(np.int64) - first
    ends = np.cumsum(rows)
    start = 0
    while start < len(rows):
        before = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, before + _ROWS, side="right")), start + 1)
        part = slice(start, stop)
        yield (part, *_spans_of(corners[part], first[part], rows[part], side))
        start = stop


def _spans_of(
    corners: NDArray[np.float64],
    first: NDArray[np.int64],
    rows: NDArray[np.int64],
    side: int,
) -> Span:
    triangle = np.repeat(np.arange(len(rows)), rows)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(rows) - rows, rows)
    row = first[triangle] + within
    low, middle, high = corners[triangle].transpose(1, 0, 2)
    long = _crossing(low, high, row)
    under = row < middle[:, 1]
    short = _crossing(
        np.where(under[:, None], low, middle), np.where(under[:, None], middle, high), row
    )
    begin, end = (
        np.clip(np.ceil(ends), 0, side).astype(np.int64)
        for ends in (np.minimum(long, short), np.maximum(long, short))
    )
    return triangle, row, begin, end


def _crossing(
    a: NDArray[np.float64], b: NDArray[np.float64], row: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Where the edge from a to b, lower end first, crosses a row."""
    height = b[:, 1] - a[:, 1]
    share = (row - a[:, 1]) / np.where(height > 0, height, 1.0)
    crossing: NDArray[np.float64] = a[:, 0] + share * (b[:, 0] - a[:, 0])
    return crossing
