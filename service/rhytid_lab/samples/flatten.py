"""UV coordinates of low distortion for a disc-shaped mesh.

As rigid as possible, after Liu et al. 2008, *A Local/Global Approach to Mesh Parameterization*.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

_EDGES = ((1, 2), (2, 0), (0, 1))


def flatten(
    positions: NDArray[Any], faces: NDArray[Any], start: NDArray[Any], iterations: int = 30
) -> NDArray[np.float64]:
    """(V, 2) plane coordinates in the unit of the positions, vertex 0 where `start` has it.

    positions: (V, 3).  faces: (F, 3).  start: (V, 2), a map without flips near the wanted one.
    Each round rotates the flattened triangles onto the map, then solves for the map whose edges
    agree best with them.
    """
    rest = _flat_triangles(np.asarray(positions, np.float64)[faces])
    weights = _cotangents(rest)
    solve = splu(_laplacian(faces, weights, len(positions)))
    plane = np.array(start, np.float64)
    for _ in range(iterations):
        right = _rotated_edges(plane[faces], rest, weights, faces, len(positions))
        right[0] += plane[0]
        plane = solve.solve(right)
    return plane


def _flat_triangles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3, 2): each triangle laid into the plane, its first edge along x."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(first, axis=1)
    along = np.sum(first * second, axis=1) / length
    height = np.linalg.norm(np.cross(first, second), axis=1) / length
    flat = np.zeros((len(corners), 3, 2))
    flat[:, 1, 0], flat[:, 2, 0], flat[:, 2, 1] = length, along, height
    return flat


def _cotangents(rest: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3) cotangent of the angle at each corner, kept positive so that nothing folds."""
    result = np.empty(rest.shape[:2])
    for corner, (i, j) in enumerate(_EDGES):
        a, b = rest[:, i] - rest[:, corner], rest[:, j] - rest[:, corner]
        cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        result[:, corner] = np.maximum(np.sum(a * b, axis=1) / cross, 0.05)
    return result


def _laplacian(faces: NDArray[Any], weights: NDArray[np.float64], count: int) -> Any:
    """The sparse Laplacian, vertex 0 held in place."""
    i = np.concatenate([faces[:, a] for a, _ in _EDGES])
    j = np.concatenate([faces[:, b] for _, b in _EDGES])
    w = np.concatenate([weights[:, k] for k in range(3)])
    rows, columns = np.concatenate([i, j, i, j, [0]]), np.concatenate([i, j, j, i, [0]])
    values = np.concatenate([w, w, -w, -w, [1.0]])
    return coo_array((values, (rows, columns)), shape=(count, count)).tocsc()


def _rotated_edges(
    corners: NDArray[np.float64],
    rest: NDArray[np.float64],
    weights: NDArray[np.float64],
    faces: NDArray[Any],
    count: int,
) -> NDArray[np.float64]:
    """(V, 2) divergence of the triangles' edges, each triangle turned onto the map (Liu, eq. 6)."""
    edges = [(rest[:, a] - rest[:, b], corners[:, a] - corners[:, b]) for a, b in _EDGES]
    c = sum(w * np.sum(e * m, axis=1) for (e, m), w in zip(edges, weights.T, strict=True))
    s = sum(
        w * (e[:, 0] * m[:, 1] - e[:, 1] * m[:, 0])
        for (e, m), w in zip(edges, weights.T, strict=True)
    )
    length = np.hypot(c, s)
    c, s = c / length, s / length
    result = np.zeros((count, 2))
    for (e, _), (a, b), w in zip(edges, _EDGES, weights.T, strict=True):
        turned = np.stack([c * e[:, 0] - s * e[:, 1], s * e[:, 0] + c * e[:, 1]], axis=1)
        np.add.at(result, faces[:, a], w[:, None] * turned)
        np.add.at(result, faces[:, b], -w[:, None] * turned)
    return result
