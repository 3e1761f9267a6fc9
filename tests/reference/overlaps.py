"""How much of a UV layout lies under several triangles: by asking points, one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array


def covers(points: ArrayLike, corners: ArrayLike) -> Array:
    """(P,) how many triangles (F, 3, 2), of either orientation, hold each point (P, 2)."""
    asked = np.asarray(points, float)
    found = np.zeros(len(asked), int)
    for a, b, c in np.asarray(corners, float):
        sides = [_left(p, q, asked) for p, q in ((a, b), (b, c), (c, a))]
        found += np.logical_and.reduce([s > 0 for s in sides])
        found += np.logical_and.reduce([s < 0 for s in sides])
    return found


def overlap_share(corners: ArrayLike, points: ArrayLike) -> float:
    """Of the points that are covered, the share that is under two triangles or more."""
    counts = covers(points, corners)
    return float((counts > 1).sum() / max((counts > 0).sum(), 1))


def _left(p: Array, q: Array, points: Array) -> Array:
    side: Array = (q[0] - p[0]) * (points[:, 1] - p[1]) - (q[1] - p[1]) * (points[:, 0] - p[0])
    return side
