"""Stretch as other methods measure it, in the shape of `stretch.stretch`: mesh tension (Raman et
al. 2023) and stretch along u and v (Zoss et al. 2020)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array
from reference.stretch import degenerate, edges


def tension(
    positions: ArrayLike, faces: ArrayLike, uv: ArrayLike, face_uv: ArrayLike, deformed: ArrayLike
) -> tuple[Array, Array]:
    """Ratios (F, 2), both the same, and axes (1, 0), (0, 1).

    Of a vertex: the mean over its edges of deformed over neutral length; 1 where it has none. Of a
    triangle: the geometric mean of its vertices. An edge is a pair of vertices, however many
    triangles have it; one without neutral length is none.
    """
    a, b = np.array(sorted(_pairs(np.asarray(faces)))).T
    neutral, moved = (
        np.linalg.norm(p[a] - p[b], axis=1)
        for p in (np.asarray(positions, np.float64), np.asarray(deformed, np.float64))
    )
    a, b, ratio = (x[neutral > 0] for x in (a, b, moved / np.where(neutral > 0, neutral, 1.0)))
    total, count = np.zeros((2, len(np.asarray(positions))))
    for end in (a, b):
        np.add.at(total, end, ratio)
        np.add.at(count, end, 1)
    mean = np.where(count > 0, total / np.maximum(count, 1), 1.0)
    with np.errstate(divide="ignore"):
        ratios = np.exp(np.log(mean)[np.asarray(faces)].mean(axis=1))
    return np.stack([ratios, ratios], axis=1), _uv_axes(len(ratios))


def uv_stretch(
    positions: ArrayLike, faces: ArrayLike, uv: ArrayLike, face_uv: ArrayLike, deformed: ArrayLike
) -> tuple[Array, Array]:
    """Ratios |J'e_u|/|J e_u| and |J'e_v|/|J e_v|, (F, 2), with axes (1, 0), (0, 1); J = ∂X/∂(u, v).

    A triangle without area in space or in UV: (1, 1).
    """
    bad = degenerate(positions, faces) | degenerate(uv, face_uv)
    from_uv = np.linalg.inv(np.where(bad[:, None, None], np.eye(2), edges(uv, face_uv)))
    neutral, moved = (
        np.linalg.norm(edges(p, faces) @ from_uv, axis=1) for p in (positions, deformed)
    )
    ratios = moved / np.where(bad[:, None], 1.0, neutral)
    ratios[bad] = 1.0
    return ratios, _uv_axes(len(ratios))


def _pairs(faces: np.ndarray) -> set[tuple[int, int]]:
    """Every edge once, as its two vertices in ascending order."""
    sides = [(int(f[i]), int(f[i - 1])) for f in faces for i in range(3)]
    return {(min(side), max(side)) for side in sides}


def _uv_axes(count: int) -> Array:
    return np.tile(np.eye(2), (count, 1, 1))
