"""What folds of a mesh take of its log compression, in float64, triangle by triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array

MOST, LEAST, MOST_BEND = 0.9, 0.5, 45.0


def taken(
    positions: ArrayLike,
    faces: ArrayLike,
    deformed: ArrayLike,
    length: float,
    rounds: int,
    normal_rounds: int,
) -> Array:
    """(F,) the share of its compression that folds take of each triangle.

    b = ℓ Σ cᵢ (κ'ᵢ − κᵢ) over the singular values of the map from neutral to deformed edges, c
    their log compression, at most 1; t what of the variance of b around each vertex is above 0.5;
    the share is the mean of 0.9 (1 - (1 + t)^(-1/4)) over the corners. Vertices at one place in the
    neutral are one.
    """
    neutral, frame = np.asarray(positions, float), np.asarray(deformed, float)
    faces = np.asarray(faces)
    _, place = np.unique(neutral, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    area = np.linalg.norm(_cross(neutral, faces), axis=1)
    mean = _Mean(corners, area)
    before = mean.normals(neutral, faces, normal_rounds)
    after = mean.normals(frame, faces, normal_rounds)
    b = np.zeros(len(faces))
    for t, face in enumerate(faces):
        if area[t] > 0:
            at = corners[t]
            b[t] = _bend(neutral[face], frame[face], before[at], after[at], length)
    first, second = mean.places(b, rounds), mean.places(b**2, rounds)
    variance = np.maximum(second - first**2 - LEAST, 0.0)
    share = MOST * (1 - (1 + variance) ** -0.25)
    found: Array = share[corners].mean(axis=1)
    return found


def _bend(old: Array, new: Array, before: Array, after: Array, length: float) -> float:
    """b of a triangle with corners (3, 3) and their normals (3, 3)."""
    edges, moved = (np.stack([p[1] - p[0], p[2] - p[0]], axis=1) for p in (old, new))
    turned, turned_after = (np.stack([n[1] - n[0], n[2] - n[0]], axis=1) for n in (before, after))
    back = np.linalg.pinv(edges)
    _, ratios, axes = np.linalg.svd(moved @ back)
    total = 0.0
    for rho, q in list(zip(ratios, axes, strict=True))[:2]:
        along = back @ q
        old_curvature = (turned @ along) @ (edges @ along)
        new_curvature = (turned_after @ along) @ (moved @ along) / max(rho**2, 1e-12)
        pressed = np.clip(-np.log(max(rho, 1e-6)), 0.0, 1.0)
        bent = np.clip(length * (new_curvature - old_curvature), -MOST_BEND, MOST_BEND)
        total += float(pressed * bent)
    return total


class _Mean:
    """Means over the triangles around places, by area, and back."""

    def __init__(self, corners: Array, area: Array) -> None:
        self._corners, count = corners, int(corners.max()) + 1
        self._weights = np.zeros((count, len(corners)))
        for t, corner in enumerate(corners):
            self._weights[corner, t] += area[t]
        self._weights /= np.maximum(self._weights.sum(axis=1, keepdims=True), 1e-300)

    def places(self, values: Array, rounds: int) -> Array:
        found = self._weights @ values
        for _ in range(rounds - 1):
            found = self._weights @ found[self._corners].mean(axis=1)
        return found

    def normals(self, positions: Array, faces: Array, rounds: int) -> Array:
        found = np.zeros((len(self._weights), 3))
        np.add.at(found, self._corners, _cross(positions, faces)[:, None, :])
        found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)
        return self.places(found[self._corners].mean(axis=1), rounds) if rounds else found


def _cross(positions: Array, faces: Array) -> Array:
    p = positions[faces]
    crossed: Array = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return crossed
