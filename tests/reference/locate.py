"""Which triangle a point of the UV plane takes its values from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from reference.boxes import PointsByU
from reference.inputs import Array, Indices
from reference.stretch import degenerate


def locate(
    points: ArrayLike, triangles: ArrayLike, padding: float, band: float = 1e-4
) -> tuple[Indices, Array]:
    """For each point: the index of its triangle or -1, and the margin of that decision.

    points: (P, 2).  triangles: (F, 3, 2), either orientation.  padding, band: UV units.

    The lowest index among the triangles that hold the point, their edges included; else the
    nearest triangle, by Euclidean distance in UV, if that is at most `padding`, the lowest index
    on ties; else -1. A triangle without area in UV holds nothing and is near nothing: it is
    skipped.

    A point that moves by less than its margin keeps its index. Margins are lower bounds, cut off
    at `band`: what lies farther than padding + 2 band from a point is not looked at.
    """
    given = (np.asarray(values, np.float64).tobytes() for values in (points, triangles))
    index, margin = _located(*given, padding, band)
    return index.copy(), margin.copy()


@lru_cache(maxsize=32)
def _located(
    all_points: bytes, all_triangles: bytes, padding: float, band: float
) -> tuple[Indices, Array]:
    """Kept for scenes that differ in their settings alone."""
    points = np.frombuffer(all_points).reshape(-1, 2)
    triangles = np.frombuffer(all_triangles).reshape(-1, 3, 2)
    search = _Search(points, padding, band)
    reach = padding + 2 * band
    low, high = triangles.min(axis=1) - reach, triangles.max(axis=1) + reach
    corners = triangles.reshape(-1, 2)
    flat = degenerate(corners, np.arange(len(corners)).reshape(-1, 3))
    strips = PointsByU(points)
    for index in strips.touched_by(low, high):
        if not flat[index]:
            search.add(index, triangles[index], strips.within(low[index], high[index]))
    return search.result()


def sample(index: Indices, log_ratios: ArrayLike, axes: ArrayLike) -> tuple[Array, Array]:
    """Log stretch (P, 2) and axes (P, 2, 2) of the triangles `index`; -1 is unstretched."""
    found = index >= 0
    logs = np.where(found[:, None], np.asarray(log_ratios, np.float64)[index], 0.0)
    directions = np.where(found[:, None, None], np.asarray(axes, np.float64)[index], np.eye(2))
    return logs, directions


class _Search:
    """Triangles come in ascending order; the first that holds a point has it for good."""

    def __init__(self, points: Array, padding: float, band: float) -> None:
        count = len(points)
        self.points, self.padding, self.band = points, padding, band
        self.holder = np.full(count, -1)
        self.hold_margin = np.full(count, band)
        self.nearest = np.full(count, -1)
        self.foot = np.full((count, 2), np.nan)
        self.distance = np.full(count, padding + 2 * band)
        self.second = self.distance.copy()
        self.tie_margin = np.full(count, band)

    def add(self, index: int, triangle: Array, rows: Indices) -> None:
        """Take one triangle into account for the points `rows`."""
        rows = rows[self.holder[rows] < 0]
        inside = depth_inside(self.points[rows], triangle)
        held = inside >= 0
        kept = rows[held]
        self.holder[kept] = index
        self.hold_margin[kept] = np.minimum(self.hold_margin[kept], inside[held])
        if not held.all():
            self._add_outside(index, triangle, rows[~held])

    def _add_outside(self, index: int, triangle: Array, rows: Indices) -> None:
        foot, distance = nearest_on_triangle(self.points[rows], triangle)
        # Any triangle before the one that holds the point would take it over.
        self.hold_margin[rows] = np.minimum(self.hold_margin[rows], distance)
        best = self.distance[rows]
        closer, equal = distance < best, (distance == best) & (self.nearest[rows] >= 0)
        self.second[rows] = np.where(
            equal, self.second[rows], np.minimum(self.second[rows], np.maximum(distance, best))
        )
        if equal.any():
            self._tie(triangle, rows[equal], foot[equal])
        won = rows[closer]
        self.nearest[won], self.distance[won] = index, distance[closer]
        self.foot[won], self.tie_margin[won] = foot[closer], self.band

    def _tie(self, triangle: Array, rows: Indices, foot: Array) -> None:
        """Equal distances. To one shared corner they last while that corner stays the foot."""
        same = (foot == self.foot[rows]).all(axis=-1)
        lasts = np.where(same, corner_margin(self.points[rows], foot, triangle), 0.0)
        self.tie_margin[rows] = np.minimum(self.tie_margin[rows], lasts)

    def result(self) -> tuple[Indices, Array]:
        near = (self.nearest >= 0) & (self.distance <= self.padding)
        gap = np.minimum((self.second - self.distance) / 2, self.tie_margin)
        margin = np.abs(self.distance - self.padding)
        margin = np.where(near, np.minimum(margin, gap), margin)
        held = self.holder >= 0
        margin = np.minimum(np.where(held, self.hold_margin, margin), self.band)
        index = np.where(held, self.holder, np.where(near, self.nearest, -1))
        return index, margin


def depth_inside(points: Array, triangle: Array) -> Array:
    """(P,) distance to the nearest of the three edge lines, negative outside the triangle."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    offset = points[:, None, :] - triangle
    side = edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0]
    turn = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
    depth: Array = (np.sign(turn) * side / np.linalg.norm(edges, axis=-1)).min(axis=-1)
    return depth


def nearest_on_triangle(points: Array, triangle: Array) -> tuple[Array, Array]:
    """Foot (P, 2) and distance (P,) of points outside of a triangle (3, 2), or of one each; a foot
    at a corner is that corner exactly, so that triangles which share it give the very same
    distance."""
    start, end = triangle, np.roll(triangle, -1, axis=-2)
    along = end - start
    share = ((points[:, None, :] - start) * along).sum(-1) / np.square(along).sum(-1)
    share = np.clip(share, 0.0, 1.0)[..., None]
    feet = np.where(share == 1.0, end, start + share * along)
    distance = np.hypot(*np.moveaxis(points[:, None, :] - feet, -1, 0))
    edge = distance.argmin(axis=-1)
    rows = np.arange(len(points))
    return feet[rows, edge], distance[rows, edge]


def corner_margin(points: Array, foot: Array, triangle: Array) -> Array:
    """(P,) how far a point may move while its foot, a corner of the triangle, stays there.

    0 where the foot is not a corner.
    """
    margin = np.zeros(len(points))
    for corner, others in zip(range(3), ((1, 2), (2, 0), (0, 1)), strict=True):
        at = (foot == triangle[corner]).all(axis=-1)
        along = triangle[list(others)] - triangle[corner]
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        behind = -((points[at] - triangle[corner]) @ along.T)
        margin[at] = np.maximum(behind.min(axis=-1), 0.0)
    return margin
