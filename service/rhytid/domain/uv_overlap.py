"""How much of a UV layout is covered by more than one triangle: counted at the points of a grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Points per side of a grid; 1 % of a UDIM is 2,600 of them.
SIDE = 512
# Rows of triangles that are checked together: bounds the memory.
_ROWS = 1 << 20
# Rows of all triangles: a layout of many large triangles is checked on a coarser grid.
_MOST_ROWS = 1 << 22
_BLOCK = 16

IntArray = NDArray[np.int64]
Span = tuple[IntArray, IntArray, IntArray, IntArray]
PartSpans = tuple[slice, IntArray, IntArray, IntArray, IntArray]


@dataclass(frozen=True)
class Overlap:
    """share: of the covered area, what two or more triangles cover.  uv: the middle of the busiest
    such place.  most: triangles that cover one point."""

    share: float
    uv: tuple[float, float]
    most: int


def overlap_of(corners: NDArray[np.float64]) -> Overlap | None:
    """Of triangles (F, 3, 2) in the unit square, what is outside is cut off; None without any.

    Each row of points cuts a triangle in one span; spans are counted by their ends. Triangles that
    share an edge share its crossing to the last bit, so that no point is counted twice for them.
    """
    side = _side(corners)
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
    """(F,) which of the triangles of `overlap_of` lie over or under another one, at a point of its
    grid."""
    side = _side(corners)
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


def _side(corners: NDArray[np.float64]) -> int:
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
