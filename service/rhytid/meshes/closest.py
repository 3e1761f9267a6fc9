"""The nearest point of a surface to each of many points, exactly, by trimesh and scipy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
# Points looked at together: bounds the memory.
_ROWS = 1 << 15
_FIRST = 8


@dataclass(frozen=True, eq=False)
class Landing:
    """triangle (P,): the nearest to each point.  weights (P, 3): barycentric coordinates of the
    nearest point in it.  distance (P,): to that."""

    triangle: IntArray
    weights: FloatArray
    distance: FloatArray


def closest(corners: FloatArray, points: FloatArray) -> Landing:
    """Of triangles (F, 3, 3) with area to points (P, 3); the lowest number on ties.

    Triangles are sorted by size into classes: one of a class lies no further from its middle than
    the largest of them, so that those with far middles need not be looked at.
    """
    classes = list(_classes(corners))
    triangle, near = np.zeros(len(points), np.int64), np.zeros((len(points), 3))
    distance = np.full(len(points), np.inf)
    for start in range(0, len(points), _ROWS):
        some = slice(start, start + _ROWS)
        for members, middles, reach in classes:
            _improve(
                corners, members, middles, reach, points[some], triangle[some], near[some],
                distance[some],
            )  # fmt: skip
    weights = _barycentric(corners[triangle], near)
    weights = np.clip(weights, 0.0, 1.0)
    return Landing(triangle, weights / weights.sum(axis=1, keepdims=True), distance)


def _classes(corners: FloatArray) -> Iterator[tuple[IntArray, FloatArray, float]]:
    """Triangles, their middles, and how far these reach at most; the largest class first."""
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    kind = np.floor(np.log2(reach / reach.max()))
    sizes, counts = np.unique(kind, return_counts=True)
    for size in sizes[np.argsort(-counts, kind="stable")]:
        members = np.flatnonzero(kind == size)
        yield members, middle[members], float(reach[members].max())


def _improve(
    corners: FloatArray,
    members: IntArray,
    middles: FloatArray,
    reach: float,
    points: FloatArray,
    triangle: IntArray,
    near: FloatArray,
    distance: FloatArray,
) -> None:
    """Take what is nearer among the members of a class, in place."""
    from scipy.spatial import cKDTree

    tree, left, count = cKDTree(middles), np.arange(len(points)), _FIRST
    while len(left):
        count = min(count, len(members))
        away, which = tree.query(points[left], k=[*range(1, count + 1)])
        for column in range(count):
            # Sorted by their middles: the rest of a row is farther where one is.
            open_ = np.flatnonzero(away[:, column] - reach < distance[left])
            if not len(open_):
                break
            rows, found = left[open_], members[which[open_, column]]
            place = _nearest(corners[found], points[rows])
            gap = np.linalg.norm(place - points[rows], axis=1)
            nearer = (gap < distance[rows]) | ((gap == distance[rows]) & (found < triangle[rows]))
            rows = rows[nearer]
            triangle[rows], near[rows], distance[rows] = found[nearer], place[nearer], gap[nearer]
        if count == len(members):
            return
        left = left[away[:, -1] - reach < distance[left]]
        count *= 4


def _nearest(corners: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 3) the point of each triangle that is nearest to a point."""
    from trimesh.triangles import closest_point

    found: FloatArray = closest_point(corners, points)  # type: ignore[no-untyped-call]
    return found


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    from trimesh.triangles import points_to_barycentric

    found: FloatArray = points_to_barycentric(corners, points)  # type: ignore[no-untyped-call]
    return found
