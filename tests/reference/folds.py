"""Where skin folds, in float64: compression by numpy's SVD, heat by dense matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array

STEPS = 3


def triangle_folds(
    positions: ArrayLike, faces: ArrayLike, expressions: Sequence[ArrayLike], limit: float
) -> Array:
    """(F, 3, 3) mean over expressions of Σ min(log ρᵢ, 0)² q̂ᵢq̂ᵢᵀ in space.

    The gradient takes neutral to deformed edges in space, normals left out: its right singular
    vectors lie in the neutral plane.
    """
    neutral, faces = np.asarray(positions, float), np.asarray(faces)
    total = np.zeros((len(faces), 3, 3))
    for f, (a, b, c) in enumerate(faces):
        edges = np.stack([neutral[b] - neutral[a], neutral[c] - neutral[a]], axis=1)
        back = np.linalg.pinv(edges)
        for shape in expressions:
            moved = np.asarray(shape, float)
            after = np.stack([moved[b] - moved[a], moved[c] - moved[a]], axis=1)
            _, ratio, axis = np.linalg.svd(after @ back)
            for rho, q in list(zip(ratio, axis, strict=True))[:2]:
                log = np.clip(np.log(max(rho, 1e-30)), -limit, 0.0)
                total[f] += log**2 * np.outer(q, q)
    return total / len(expressions)


def spread(positions: ArrayLike, faces: ArrayLike, values: Array, sigma: float) -> Array:
    """(V, …) values (F, …) of triangles averaged to vertices by area, then heat for sigma²/2."""
    x, faces = np.asarray(positions, float), np.asarray(faces)
    count = len(x)
    mass, stiff, total = (
        np.zeros(count),
        np.zeros((count, count)),
        np.zeros((count, *values.shape[1:])),
    )
    for f, corners in enumerate(faces):
        a, b, c = x[corners]
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
        for k in range(3):
            i, j, o = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
            mass[i] += area / 3
            total[i] += area / 3 * values[f]
            one, two = x[i] - x[o], x[j] - x[o]
            angle = np.arccos(one @ two / np.linalg.norm(one) / np.linalg.norm(two))
            w = 0.5 * max(1 / np.tan(angle), 0.0)
            stiff[[i, j], [i, j]] += w
            stiff[[i, j], [j, i]] -= w
    found = total.reshape(count, -1) / mass[:, None]
    for _ in range(STEPS):
        matrix = np.diag(mass) + 0.5 * sigma**2 / STEPS * stiff
        found = np.linalg.solve(matrix, mass[:, None] * found)
    return found.reshape(total.shape)
