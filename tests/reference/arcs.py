"""Wrinkles that bend and taper: the nearest point of an arc, by brute force."""

from __future__ import annotations

import numpy as np

from reference.inputs import Array

# Points of the first row, and of the denser ones around what was nearest, each a twentieth as long.
GRID, FINER, ROUNDS = 400, 40, 4


def offset(s: Array, slopes: Array) -> Array:
    """y(s) over a chord of length 1, to its left; slopes: dy/dx at both ends."""
    return s * (1 - s) * (slopes[0] * (1 - s) - slopes[1] * s)


def nearest(points: Array, start: Array, end: Array, slopes: Array) -> tuple[Array, Array]:
    """Of points (P, 2) the place s (P,) on the arc that is nearest, 0 to 1, and the distance (P,):
    the nearest of a dense row of points, then of denser rows around it."""
    along = end - start
    length = np.linalg.norm(along)
    axes = np.array([along, [-along[1], along[0]]]) / length**2
    x, y = axes @ (points - start).T
    s, reach = np.full(len(points), 0.5), 0.5
    for grid in (GRID, *ROUNDS * [FINER]):
        row = np.clip(s[:, None] + reach * np.linspace(-1, 1, grid + 1), 0.0, 1.0)
        away = np.hypot(x[:, None] - row, y[:, None] - offset(row, slopes))
        s = np.take_along_axis(row, away.argmin(axis=1)[:, None], axis=1)[:, 0]
        reach *= 2.0 / grid
    return s, length * np.hypot(x - s, y - offset(s, slopes))


def box(start: Array, end: Array, slopes: Array) -> tuple[Array, Array]:
    """Corners around the arc, from many points of it."""
    s = np.linspace(0, 1, 1001)[:, None]
    left = np.array([start[1] - end[1], end[0] - start[0]])
    curve = start + s * (end - start) + offset(s, slopes) * left
    slack = 1e-3 * np.linalg.norm(end - start)
    return curve.min(axis=0) - slack, curve.max(axis=0) + slack


def between(ends: Array, s: Array) -> Array:
    """Linear from the value at the start to that at the end; a single value throughout."""
    ends = np.atleast_1d(ends)
    return ends[0] + (ends[-1] - ends[0]) * s
