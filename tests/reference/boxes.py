"""Finding the points in a box without looking at all of them."""

from __future__ import annotations

import numpy as np

from reference.inputs import Array, Indices


class PointsByU:
    """Points (P, 2) sorted by u once, so that a box costs two bisections and one strip."""

    def __init__(self, points: Array) -> None:
        self._order = np.argsort(points[:, 0], kind="stable")
        self._u, self._v = points[self._order].T
        empty = len(points) == 0
        self._low = np.full(2, np.inf) if empty else points.min(axis=0)
        self._high = np.full(2, -np.inf) if empty else points.max(axis=0)

    def within(self, low: Array, high: Array) -> Indices:
        """Indices of the points p with low <= p <= high; low, high: (2,)."""
        first = np.searchsorted(self._u, low[0], side="left")
        last = np.searchsorted(self._u, high[0], side="right")
        strip = self._v[first:last]
        return self._order[first:last][(strip >= low[1]) & (strip <= high[1])]

    def touched_by(self, low: Array, high: Array) -> Indices:
        """Indices of the boxes (B, 2), (B, 2) that meet the box around all the points."""
        return np.flatnonzero(((low <= self._high) & (high >= self._low)).all(axis=-1))
