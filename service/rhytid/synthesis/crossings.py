"""Which wrinkles cross which."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points

_ROWS = 1 << 20


def crossings(
    pores: Points, nodes: IntArray, length: FloatArray, progress: Progress = silent
) -> IntArray:
    """(P, 2) pairs of edges that cross, seen along the normal between them.

    nodes: (E, 2).  length: (E,).  Edges with a common pore do not cross, nor do those of
    different sheets.
    """
    if not len(nodes):
        return np.empty((0, 2), np.int64)
    middle = pores.position[nodes].mean(axis=1)
    pairs = cKDTree(middle).query_pairs(length.max(), output_type="ndarray")
    found = [np.empty((0, 2), np.int64)]
    for first in range(0, len(pairs), _ROWS):
        progress(first / len(pairs), "crossings")
        block = pairs[first : first + _ROWS]
        found.append(block[_cross(pores, nodes, block)])
    return np.concatenate(found)


def _cross(pores: Points, nodes: IntArray, pairs: IntArray) -> BoolArray:
    """(P,) true where the two segments of a pair cross."""
    (a, b), (c, d) = nodes[pairs[:, 0]].T, nodes[pairs[:, 1]].T
    separate = (a != c) & (a != d) & (b != c) & (b != d)
    a, b, c, d = a[separate], b[separate], c[separate], d[separate]
    normal = pores.normal[a] + pores.normal[b]
    facing = np.einsum("nx,nx->n", normal, pores.normal[c] + pores.normal[d])
    p, q, r, s = (pores.position[node] for node in (a, b, c, d))
    parted = _side(q - p, r - p, normal) * _side(q - p, s - p, normal) < 0
    parting = _side(s - r, p - r, normal) * _side(s - r, q - r, normal) < 0
    result = np.zeros(len(pairs), bool)
    result[separate] = parted & parting & (facing > 0)
    return result


def _side(along: FloatArray, to: FloatArray, normal: FloatArray) -> FloatArray:
    """(N,) on which side of `along` the vector `to` points, seen along the normal."""
    side: FloatArray = np.einsum("nx,nx->n", np.cross(along, to), normal)
    return side
