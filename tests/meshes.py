"""Small meshes made by rule, for tests that need a mesh but no face."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Positions = NDArray[np.float32]


class SmallMesh(NamedTuple):
    """positions (V, 3) f32, faces (F, 3) i32, uv (T, 2) f32, face_uv (F, 3) i32."""

    positions: Positions
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]
    face_uv: NDArray[np.int32]


def bumpy_grid(n: int = 10, seed: int = 0) -> SmallMesh:
    """A bumpy sheet, 2 by 2 in space, of 2n² triangles, n even, with a UV seam down the middle.

    Its halves are two warped charts in tile 1001 with a gap between them, none mirrored, and a
    margin to the border. The vertices on the seam have two uv each; uv indices are shuffled, so
    they differ from position indices everywhere.
    """
    rng = np.random.default_rng(seed)
    square = _lattice(n + 1, n + 1)
    positions = np.concatenate([2 * square - 1, _waves(square, rng, 1) * 0.3], axis=1)
    charts, half = _charts(n, rng), _quads(n + 1, n // 2 + 1)
    order = rng.permutation(len(charts))
    uv = np.empty_like(charts)
    uv[order] = charts
    left = half + (half // (n // 2 + 1)) * (n // 2)  # from the columns of a half to all columns
    faces = np.concatenate([left, left + n // 2])
    face_uv = order[np.concatenate([half, half + len(charts) // 2])]
    return SmallMesh(
        positions.astype(np.float32),
        faces.astype(np.int32),
        uv.astype(np.float32),
        face_uv.astype(np.int32),
    )


def deform(positions: Positions, seed: int, amount: float = 0.2) -> Positions:
    """Smooth random displacement of vertices; `amount` is its size in units of the bounding box,
    at most, in each coordinate."""
    rng = np.random.default_rng(seed)
    low = positions.min(axis=0).astype(np.float64)
    size = float((positions.max(axis=0) - low).max())
    waves = _waves((positions - low) / size, rng, 3)
    return (positions + amount * size * waves).astype(np.float32)


def rotate_translate(positions: Positions, seed: int) -> Positions:
    """A rigid motion: positions (V, 3) turned by a random rotation, then shifted."""
    rng = np.random.default_rng(seed)
    moved = positions @ rotation(rng).T + rng.uniform(-1, 1, 3)
    return moved.astype(np.float32)


def rotation(rng: np.random.Generator, size: int = 3) -> NDArray[np.float64]:
    """A random rotation matrix (size, size), determinant 1."""
    q, r = np.linalg.qr(rng.standard_normal((size, size)))
    q = q * np.sign(np.diagonal(r))
    q[:, 0] *= np.linalg.det(q)
    return q


def _charts(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """uv of the left half, then of the right: a turned, sheared, rippled lattice each."""
    lattice = _lattice(n + 1, n // 2 + 1) - 0.5
    charts = []
    for middle in (0.27, 0.73):
        angle = rng.uniform(-0.3, 0.3)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        ripple = lattice + 0.04 * _waves(lattice, rng, 2)
        charts.append(ripple * (0.28, 0.6) @ turn.T + (middle, 0.5))
    return np.concatenate(charts)


def _lattice(rows: int, columns: int) -> NDArray[np.float64]:
    """(rows · columns, 2) points of the unit square, x fastest."""
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    return np.stack([x, y], axis=-1).reshape(-1, 2)


def _quads(rows: int, columns: int) -> NDArray[np.int64]:
    """(2(rows - 1)(columns - 1), 3) counter-clockwise triangles of a lattice."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    lower = corner + np.array([0, 1, columns + 1])
    upper = corner + np.array([0, columns + 1, columns])
    return np.stack([lower, upper], axis=1).reshape(-1, 3)


def _waves(points: NDArray[np.float64], rng: np.random.Generator, k: int) -> NDArray[np.float64]:
    """(P, k) smooth random values in [-1, 1]: the mean of three sines, 0.2 to 0.8 periods wide."""
    direction = rng.uniform(-1, 1, (3, points.shape[1], k))
    direction *= rng.uniform(0.2, 0.8, (3, 1, k)) / np.linalg.norm(direction, axis=1, keepdims=True)
    phase = 2 * np.pi * (np.einsum("pd,wdk->wpk", points, direction) + rng.uniform(0, 1, (3, 1, k)))
    waves: NDArray[np.float64] = np.sin(phase).mean(axis=0)
    return waves
