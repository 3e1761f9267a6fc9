"""The neutral face: an egg of cross-sections, then a sculptor's hills and grooves. In cm.

The chart has two coordinates. q is the height along the midline, 0 between nose and brow, the
mouth line at `MOUTH`. a is the arc length across, 0 at the midline. A point of the egg is
`midline(q) + w(q) · right - depth · back(q)`: the sections are superellipses, tilted as a fan so
that those of the chin run up to the ear and those of the forehead down to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid_lab.samples.fields import Field, hill, pair, ramp, ridge, through
from rhytid_lab.samples.grids import grid_indices, rounded

BOTTOM, TOP = -11.8, 11.4
SWEEP = 1.42
MOUTH = -6.0
MOUTH_HALF_WIDTH = 2.4

_TILT = ((-13.0, -1.35), (-11.4, -0.9), (-9.6, -0.05), (-6.0, 0.0), (4.0, 0.1), (12.0, 1.05))
_FAN = 0.036
_HALF_WIDTH = (
    (-12.5, 5.4), (-10.0, 6.1), (-7.0, 6.95), (-3.0, 7.75), (1.0, 8.2), (6.0, 8.2), (12.0, 7.2),
)  # fmt: skip
_DEPTH = ((-12.5, 8.6), (-6.0, 9.4), (2.0, 9.9), (13.0, 9.2))
_ROUNDNESS = 0.74
_NOSE_HEIGHT = (
    (-4.8, 0.0), (-4.2, 0.3), (-3.6, 0.95), (-3.0, 1.5), (-2.4, 1.68), (-1.4, 1.5), (0.3, 0.95),
    (1.6, 0.55), (3.6, 0.0),
)  # fmt: skip
_NOSE_WIDTH = ((-4.5, 1.1), (-2.9, 1.15), (-1.4, 1.1), (0.3, 1.0), (2.5, 1.1))
_ROUNDING = 0.8


@dataclass(frozen=True, eq=False)
class Chart:
    """Vertices (V,) in the coordinates that features and expressions are written in.

    x: signed distance from the midplane on the egg.  q: height along the midline.
    point, right, up, out: (V, 3) the egg and its orthonormal frame.
    """

    x: Field
    q: Field
    point: Field
    right: Field
    up: Field
    out: Field

    def at(self, index: NDArray[np.integer[Any]]) -> Chart:
        """The vertices at `index`."""
        arrays = (self.x, self.q, self.point, self.right, self.up, self.out)
        return Chart(*(a[index] for a in arrays))


def egg(angle: Field, q: Field) -> Field:
    """(…, 3) points of the head without features; `angle` in radians from the midline."""
    y, z = _midline(q)
    s, c = np.sin(angle), np.cos(angle)
    radius = (s**4 + c**4 + 2 * _ROUNDNESS * s * s * c * c) ** -0.25
    back = through(q, _DEPTH) * (1 - radius * c)
    fan = _FAN * q
    x = through(q, _HALF_WIDTH) * radius * s
    return np.stack([x, y - back * np.sin(fan), z - back * np.cos(fan)], axis=-1)


def chart(angle: Field, q: Field) -> Chart:
    """The egg with its frame, by central differences."""
    step = 1e-4
    across = egg(angle + step, q) - egg(angle - step, q)
    along = egg(angle, q + step) - egg(angle, q - step)
    right = _unit(across)
    out = _unit(np.cross(across, along))
    point = egg(angle, q)
    return Chart(point[:, 0], q, point, right, np.cross(out, right), out)


def sculpt(c: Chart) -> Field:
    """(V, 3) the face: the egg plus its features."""
    forward = np.array([0.0, 0.0, 1.0])
    out = _skull(c) + _eyes(c) + _mouth(c)
    nose = _nose(c)
    droop = 0.15 * hill(c.x, c.q, (0, -2.9), (0.9, 0.7))
    moved: Field = out[:, None] * c.out + nose[:, None] * forward - droop[:, None] * c.up
    return c.point + moved


def _skull(c: Chart) -> Field:
    x, q = c.x, c.q
    return (
        0.30 * ridge(x, q, [(1.3, 2.5), (3.4, 2.95), (5.9, 2.0)], 0.75)
        + 0.16 * hill(x, q, (0, 2.5), (1.0, 0.8))
        + 0.25 * pair(x, q, (2.4, 6.3), (2.2, 1.8))
        - 0.30 * pair(x, q, (7.0, 3.4), (1.5, 2.2))
        + 0.34 * pair(x, q, (5.2, -1.2), (2.0, 1.5))
        + 0.40 * pair(x, q, (3.6, -2.6), (1.5, 1.5))
        - 0.22 * pair(x, q, (5.4, -5.0), (1.6, 1.8))
        + 0.25 * pair(x, q, (5.4, -8.0), (1.8, 1.4))
        + 0.80 * hill(x, q, (0, -9.2), (1.7, 1.05))
    )


def _eyes(c: Chart) -> Field:
    x, q = c.x, c.q
    ball = np.clip(1 - ((np.abs(x) - 3.2) / 1.7) ** 2 - ((q - 0.75) / 1.4) ** 2, 0, 1)
    return (
        -0.85 * pair(x, q, (3.25, 0.85), (1.7, 1.25))
        - 0.50 * pair(x, q, (1.5, 0.9), (0.6, 0.9))
        + 0.62 * ball * ball * (3 - 2 * ball)
        - 0.13 * ridge(x, q, [(1.6, 0.55), (3.2, 0.05), (4.9, 0.55)], 0.10)
        + 0.08 * ridge(x, q, [(1.6, 0.76), (3.2, 0.28), (4.9, 0.75)], 0.11)
        - 0.12 * ridge(x, q, [(1.5, 0.9), (3.2, 1.65), (5.2, 0.85)], 0.16)
        - 0.05 * ridge(x, q, [(1.5, 0.0), (3.2, -0.9), (5.0, -0.4)], 0.32)
    )


def _nose(c: Chart) -> Field:
    x, q = c.x, c.q
    height = through(q, _NOSE_HEIGHT)
    section = np.exp(-((np.abs(x) / through(q, _NOSE_WIDTH)) ** 2.2))
    return (
        height * section
        + 0.28 * hill(x, q, (0, -2.8), (0.62, 0.55))
        + 0.75 * pair(x, q, (1.2, -3.15), (0.45, 0.42))
        - 0.12 * ridge(x, q, [(1.1, -2.3), (1.75, -2.8), (2.1, -3.8)], 0.2)
        - 0.35 * pair(x, q, (0.62, -3.75), (0.26, 0.2))
    )


def _mouth(c: Chart) -> Field:
    x, q = c.x, c.q
    across = np.abs(x) / MOUTH_HALF_WIDTH
    full = np.clip(1 - across**2, 0, 1)
    bow = 0.28 + 0.62 * full**0.8 - 0.2 * np.exp(-((x / 0.3) ** 2))
    pout = 0.22 + 0.85 * full
    upper = np.exp(-0.5 * ((q - MOUTH - 0.5 * bow) / (0.34 * bow)) ** 2)
    lower = np.exp(-0.5 * ((q - MOUTH + 0.52 * pout) / (0.36 * pout)) ** 2)
    line = np.exp(-0.5 * ((q - MOUTH) / 0.15) ** 2)
    return (
        0.65 * hill(x, q, (0, -5.8), (2.6, 1.8))
        + 0.42 * ramp(across, 1.1, 0.2) * upper
        + 0.42 * ramp(across, 1.05, 0.2) * lower
        - 0.30 * ramp(across, 1.12, 0.8) * line
        - 0.11 * hill(x, q, (0, -4.75), (0.26, 0.45))
        + 0.06 * pair(x, q, (0.5, -4.85), (0.25, 0.5))
        - 0.20 * pair(x, q, (2.55, MOUTH - 0.05), (0.42, 0.45))
        - 0.32 * hill(x, q, (0, -7.5), (1.3, 0.45))
        - 0.07 * ridge(x, q, [(1.7, -3.4), (2.7, -4.7), (3.6, -6.6)], 0.45)
    )


def _midline(q: Field) -> tuple[Field, Field]:
    """(y, z) of the profile: its tilt integrated along q."""
    s = np.linspace(-14, 14, 2801)
    tilt = through(s, _TILT)
    step = s[1] - s[0]
    y, z = np.cumsum(np.cos(tilt)) * step, -np.cumsum(np.sin(tilt)) * step
    zero = np.searchsorted(s, 0.0)
    return np.interp(q, s, y - y[zero]), np.interp(q, s, z - z[zero])


def _unit(v: Field) -> Field:
    result: Field = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return result


@dataclass(frozen=True, eq=False)
class Grid:
    """A (n + 1)² grid over the chart, row 0 at the chin, symmetric about the middle column.

    angle, q: (n + 1, n + 1) chart coordinates.  row: the grid row that lies on the mouth line.
    """

    angle: Field
    q: Field
    row: int

    @property
    def mirror(self) -> NDArray[np.int32]:
        """(V,) the vertex on the other side of the midplane."""
        return grid_indices(len(self.q) - 1)[:, ::-1].ravel()

    def lips(self, x: Field) -> NDArray[np.int32]:
        """Vertices of the mouth line between its corners; x: (V,) signed distances."""
        line: NDArray[np.int32] = grid_indices(len(self.q) - 1)[self.row]
        return line[np.abs(x[line]) < MOUTH_HALF_WIDTH]


def rounded_grid(n: int) -> Grid:
    """A grid of n² quads, n even, dense around eyes, nose and mouth, with rounded corners."""
    t = np.linspace(-1, 1, n + 1)
    middle, half = (TOP + BOTTOM) / 2, (TOP - BOTTOM) / 2
    s = _spaced(t, -SWEEP, SWEEP, lambda a: 1 + 2 * ramp(np.abs(a), 0.85, 0.5)) / SWEEP
    v = _spaced(t, BOTTOM, TOP, lambda q: 1 + 2.2 * ramp(q, -9.5, -7) * ramp(q, 5, 2.5))
    across, along = np.meshgrid(s, (v - middle) / half)
    across, along = rounded(across, along, _ROUNDING)
    angle, q = SWEEP * across, middle + half * along
    row = int(np.argmin(np.abs(q[:, n // 2] - MOUTH)))
    near = np.exp(-0.5 * ((q - q[row]) / 1.8) ** 2) * ramp(np.abs(angle), 0.9, 0.45)
    return Grid(angle, q + (MOUTH - q[row]) * near, row)


def cut(faces: NDArray[Any], line: NDArray[Any], row: int, count: int) -> NDArray[np.int32]:
    """Faces with the vertices of `line` doubled: those above get new ones, count, count + 1, …"""
    columns = round(count**0.5)
    above = (faces // columns).max(axis=1) > row
    copy = np.arange(count, dtype=np.int32)
    copy[line] = count + np.arange(len(line), dtype=np.int32)
    return np.where(above[:, None], copy[faces], faces)


def _spaced(t: Field, low: float, high: float, density: Callable[[Field], Field]) -> Field:
    """Points from `low` (t = -1) to `high` (t = 1), as close together as `density` is high."""
    x = np.linspace(low, high, 4001)
    rho = density(x)
    total = np.concatenate([[0.0], np.cumsum(rho[1:] + rho[:-1])])
    return np.interp((t + 1) / 2, total / total[-1], x)
