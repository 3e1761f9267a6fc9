"""The topology of the face: a rounded grid of triangles, cut open along the mouth line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid_lab.samples.face_shape import BOTTOM, MOUTH, MOUTH_HALF_WIDTH, SWEEP, TOP
from rhytid_lab.samples.fields import Field, ramp
from rhytid_lab.samples.grids import grid_indices, rounded

_ROUNDING = 0.8


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
