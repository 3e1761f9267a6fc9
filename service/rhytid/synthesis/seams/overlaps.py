"""Where charts overlap, as those of mirrored halves do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.support import cancellation

# How many triangles around a centre are looked at: the one below is among the nearest unless it
# is very much larger.
NEIGHBOURS = 8


def covered(uv: NDArray[np.float64], usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(F,) true where the centre of a triangle, uv (F, 3, 2), lies in one of a lower index.

    The lowest index wins a place in the map: what a covered triangle carried would be drawn over
    the winner's wrinkles.
    """
    index = np.flatnonzero(usable)
    centres = uv[index].mean(axis=1)
    near = cKDTree(centres).query(centres, k=min(NEIGHBOURS, len(index)), workers=-1)[1]
    result = np.zeros(len(uv), bool)
    for other in near.reshape(len(index), -1).T:
        cancellation.check()
        result[index] |= (other < np.arange(len(index))) & _inside(centres, uv[index[other]])
    return result


def _inside(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) true where a point (N, 2) lies within its triangle (N, 3, 2), not on the edge."""
    sides, to = np.roll(corners, -1, axis=1) - corners, points[:, None] - corners
    turn = np.sign(sides[..., 0] * to[..., 1] - sides[..., 1] * to[..., 0])
    inside: NDArray[np.bool_] = np.abs(turn.sum(axis=1)) == 3
    return inside
