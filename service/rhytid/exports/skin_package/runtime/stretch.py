"""Log stretch and axes of every triangle of a deformed mesh, in the layout of the shader's texture.

Part of a skin package of rhytid; needs numpy alone. Edges are differences of positions before
anything is multiplied, so that float32 does where triangles are no slivers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
# Of a triangle that is pressed to nothing.
LEAST_LOG = -100.0
# Numbers of a triangle in triangles.bin: 1/l, d/l and 1/h of its neutral edges, 1 where it has area
# in space and in UV, else 0; then the matrix from its frame to UV, row by row.
REST = 8
# A triangle whose area is below this share of its longest edge squared has no usable stretch.
DEGENERATE_AREA = 1e-7


def rest_of(positions: Array, faces: Array, corners: Array) -> NDArray[np.float64]:
    """(F, 8) what stretch needs of the neutral. positions (V, 3), faces (F, 3), corners (F, 3, 2):
    UV, v up."""
    points = np.asarray(positions, float)[faces]
    flat = np.asarray(corners, float)
    usable = _has_area(points, _cross_length(points)) & _has_area(flat, np.abs(_area_uv(flat)))
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    with np.errstate(all="ignore"):
        length = np.linalg.norm(first, axis=1)
        d, h = (first * second).sum(1) / length, _cross_length(points) / length
        along = (flat[:, 1] - flat[:, 0]) / length[:, None]
        across = (flat[:, 2] - flat[:, 0] - along * d[:, None]) / h[:, None]
        columns = [1 / length, d / length, 1 / h, np.ones(len(h))]
        matrix = np.stack([along[:, 0], across[:, 0], along[:, 1], across[:, 1]], axis=1)
        matrix /= np.abs(matrix).max(axis=1, keepdims=True)
        found = np.concatenate([np.stack(columns, axis=1), matrix], axis=1)
    return np.where(usable[:, None], found, 0.0)


def read_rest(file: str | Path) -> NDArray[np.float64]:
    """(F, 8) of a package's triangles.bin."""
    return np.fromfile(file, "<f8").reshape(-1, REST)


def log_stretch(
    positions: Array,
    faces: Array,
    rest: Array,
    dtype: type[np.floating[Any]] = np.float64,
    folds: Array | float = 0.0,
) -> NDArray[np.float32]:
    """(F, 8) float32 of each triangle: the unit axes s1 and s2 in UV (u, v of each), log rho1 and
    log rho2, not clamped, rho1 >= rho2, the share that folds take of compression, and 0.

    positions (V, 3): of the frame, in the unit of the package.  dtype: what is computed in.
    folds: (F,) of folds.py.
    """
    p = np.asarray(positions, dtype)[faces]
    r = np.asarray(rest, dtype)
    usable = r[:, 3] > 0
    with np.errstate(all="ignore"):
        a, b, d = _gradient(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], r)
        logs = _logs(a, b, d)
        v = _right_vector(a, b, d)
        axes = [_to_uv(r, v), _to_uv(r, np.stack([-v[:, 1], v[:, 0]], axis=1))]
    found = np.zeros((len(r), 8), np.float32)
    found[:, :4] = np.where(usable[:, None], np.concatenate(axes, axis=1), (1, 0, 0, 1))
    found[:, 4:6] = np.where(usable[:, None], logs, 0)
    found[:, 6] = folds
    return found


def texture(stretch: Array, per_row: int) -> NDArray[np.float32]:
    """(rows, 2 per_row, 4) float32: two texels of each triangle, `per_row` triangles in a row, and
    one unstretched entry after the last, for texels in no triangle."""
    rows = -(-(len(stretch) + 1) // per_row)
    found = np.zeros((rows * per_row, 8), np.float32)
    found[:, :4] = (1, 0, 0, 1)
    found[: len(stretch)] = stretch
    return found.reshape(rows, 2 * per_row, 4)


def _gradient(first: Array, second: Array, rest: Array) -> tuple[Array, Array, Array]:
    """The upper triangular matrix that takes neutral to deformed edges: f11, f12, f22."""
    length = np.sqrt((first * first).sum(1))
    point = length <= 0  # the first edge is a point: lay the second along the axis
    safe = np.where(point, 1, length)
    area = np.cross(first, second)
    d = np.where(point, np.sqrt((second * second).sum(1)), (first * second).sum(1) / safe)
    h = np.where(point, 0, np.sqrt((area * area).sum(1)) / safe)
    return length * rest[:, 0], (d - length * rest[:, 1]) * rest[:, 2], h * rest[:, 2]


def _logs(a: Array, b: Array, d: Array) -> Array:
    """(F, 2). The smaller singular value comes from the determinant: nothing cancels."""
    larger = (np.hypot(a + d, b) + np.hypot(a - d, b)) / 2
    smaller = np.where(larger > 0, a * d / np.where(larger > 0, larger, 1), 0)
    logs: Array = np.maximum(np.log(np.stack([larger, smaller], axis=1)), LEAST_LOG)
    return logs


def _right_vector(a: Array, b: Array, d: Array) -> Array:
    """(F, 2) the direction of the larger one, in the frame of the neutral triangle."""
    c, s = (a - d) * (a + d) - b * b, 2 * a * b
    radius = np.hypot(c, s)
    x = np.where(c > 0, radius + c, np.abs(s))
    y = np.where(c > 0, s, np.copysign(radius - c, s))
    length = np.hypot(x, y)
    round_ = ~(length > 0)  # stretched alike in all directions
    safe = np.where(round_, 1, length)
    return np.stack([np.where(round_, 1, x / safe), np.where(round_, 0, y / safe)], axis=1)


def _to_uv(rest: Array, v: Array) -> Array:
    u = rest[:, 4] * v[:, 0] + rest[:, 5] * v[:, 1]
    w = rest[:, 6] * v[:, 0] + rest[:, 7] * v[:, 1]
    length = np.hypot(u, w)
    return np.stack([u / length, w / length], axis=1)


def _cross_length(points: Array) -> Array:
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    length: Array = np.linalg.norm(np.cross(first, second), axis=1)
    return length


def _area_uv(flat: Array) -> Array:
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    twice: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return twice


def _has_area(corners: Array, twice: Array) -> Array:
    sides = corners - np.roll(corners, 1, axis=1)
    longest = (sides * sides).sum(-1).max(-1)
    good: Array = (twice / 2 >= DEGENERATE_AREA * longest) & (longest > 0)
    return good
