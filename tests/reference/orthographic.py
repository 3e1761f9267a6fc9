"""What a square patch shows at each pixel: one ray a pixel, every triangle tried, float64."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def tangent_axes(normal: Array) -> Array:
    """(3, 3) rows: right, up (world y projected), the unit normal."""
    n = normal / np.linalg.norm(normal)
    up = np.array([0.0, 1.0, 0.0]) - n[1] * n
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, n), up, n])


def ray_uv(corners: Array, uv: Array, origin: Array, axes: Array, side: float, size: int) -> Array:
    """(size, size, 2) uv of the hit nearest to the viewer that faces it; nan where there is none.

    corners: (F, 3, 3).  uv: (F, 3, 2).
    """
    result = np.full((size, size, 2), np.nan)
    for i in range(size):
        for j in range(size):
            right, up = ((j + 0.5) / size - 0.5) * side, (0.5 - (i + 0.5) / size) * side
            point = origin + right * axes[0] + up * axes[1]
            best = -np.inf
            for (a, b, c), t in zip(corners, uv, strict=True):
                if np.cross(b - a, c - a) @ axes[2] <= 0:
                    continue
                # point + s n = a + p (b - a) + q (c - a)
                system = np.stack([b - a, c - a, -axes[2]], axis=1)
                p, q, s = np.linalg.solve(system, point - a)
                if min(p, q, 1 - p - q) >= -1e-9 and s > best:
                    best, result[i, j] = s, (1 - p - q) * t[0] + p * t[1] + q * t[2]
    return result
