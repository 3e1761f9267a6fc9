"""Square grids of triangles, and how their corners are rounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid_lab.samples.fields import Field


def grid_indices(n: int) -> NDArray[np.int32]:
    """(n + 1, n + 1) vertex numbers of a grid of n² quads, row by row."""
    return np.arange((n + 1) ** 2, dtype=np.int32).reshape(n + 1, n + 1)


def grid_faces(n: int) -> NDArray[np.int32]:
    """(2 n², 3) triangles, counter-clockwise with rows going up, symmetric for an even n.

    Every diagonal points to the middle, so that no triangle is lost where a corner is rounded.
    """
    index = grid_indices(n)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    left, low = np.arange(n) < n // 2, np.arange(n)[:, None] < n // 2
    rising = (left == low)[..., None]
    first = np.where(rising, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    second = np.where(rising, np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    return np.concatenate([first, second], axis=1).reshape(-1, 3)


def flat_sheet(side: float, n: int) -> Mesh:
    """A square of n² quads around the origin, `side` mesh units wide, that faces +z. It takes 0.96
    of the UV square."""
    line = np.linspace(-0.5, 0.5, n + 1)
    x, y = np.meshgrid(line, line)
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    positions = np.concatenate([side * flat, np.zeros((len(flat), 1))], axis=1)
    faces = grid_faces(n)
    return Mesh(positions.astype(np.float32), faces, 0.5 + 0.96 * flat, faces)


def rounded(x: Field, y: Field, amount: float) -> tuple[Field, Field]:
    """The square [-1, 1]² with its corners drawn in: `amount` 0 keeps it, 1 gives the unit disc."""
    return x * np.sqrt(1 - amount * y * y / 2), y * np.sqrt(1 - amount * x * x / 2)
