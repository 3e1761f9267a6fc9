"""Log stretch as a tensor on the deformed surface, and the late log of areas, triangle by triangle
and frame by frame in float64."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array


def hencky(neutral: ArrayLike, deformed: ArrayLike, most: float) -> Array:
    """(3, 3) log of sqrt(F Fᵀ) of one triangle in space, (3, 3) corners each; logs within ±most.

    F takes the edges and the normal of the neutral triangle to the deformed edges and 0.
    """
    rest, now = np.asarray(neutral, np.float64), np.asarray(deformed, np.float64)
    first, second = rest[1] - rest[0], rest[2] - rest[0]
    source = np.stack([first, second, np.cross(first, second)], axis=1)
    target = np.stack([now[1] - now[0], now[2] - now[0], np.zeros(3)], axis=1)
    left, ratios, _ = np.linalg.svd(target @ np.linalg.inv(source))
    logs = np.array([min(max(math.log(max(r, 1e-300)), -most), most) for r in ratios[:2]])
    found: Array = (left[:, :2] * logs) @ left[:, :2].T
    return found


def turning(normal: ArrayLike, to: ArrayLike) -> Array:
    """(3, 3) the rotation that takes one unit vector to another the shortest way (Rodrigues)."""
    a, b = np.asarray(normal, np.float64), np.asarray(to, np.float64)
    v = np.cross(a, b)
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    found: Array = np.eye(3) + k + k @ k / (1.0 + a @ b)
    return found


def late(times: Sequence[float], values: Sequence[float], seconds: float, reach: float) -> float:
    """y at the last time of dy/dt = (x - y) / seconds, x constant up to each time since the one
    before; y is x at the first time within `reach` time constants."""
    near = [i for i, t in enumerate(times) if t >= times[-1] - reach * seconds - 1e-12]
    y = values[near[0]]
    for before, i in pairwise(near):
        y = values[i] + (y - values[i]) * math.exp((times[before] - times[i]) / seconds)
    return y
