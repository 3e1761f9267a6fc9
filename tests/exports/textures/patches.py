"""A curved patch with a known surface, and maps on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

FloatArray = NDArray[np.float64]
Surface = Callable[[FloatArray, FloatArray], FloatArray]
SIDE = 256


def curved(u: FloatArray, v: FloatArray) -> FloatArray:
    """A saddle, sheared and stretched: u and v are neither orthogonal nor evenly long on it."""
    x, y = u + 0.4 * v + 0.1 * u * u, 1.3 * v + 0.15 * u * v
    return np.stack([x, y, 0.3 * x * x - 0.2 * y * y + 0.1 * x * y], axis=-1)


def waves(u: FloatArray, v: FloatArray) -> FloatArray:
    """Slopes up to about 20 degrees in any direction."""
    return 0.008 * np.sin(43 * u + 11 * v) * np.cos(37 * v - 9 * u)


def grid_mesh(surface: Surface, cells: int, *, mirrored: bool = False) -> Mesh:
    """A patch as a grid of triangles whose UV are the unit square; mirrored: u runs against it."""
    line = np.linspace(0.0, 1.0, cells + 1)
    u, v = (part.reshape(-1) for part in np.meshgrid(line, line))
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    faces = np.concatenate(
        [corner + np.array([0, 1, cells + 2]), corner + np.array([0, cells + 2, cells + 1])]
    )
    uv = np.stack([1.0 - u if mirrored else u, v], axis=1)
    return Mesh(surface(u, v).astype(np.float32), faces, uv, faces)


def centres(side: int = SIDE) -> tuple[FloatArray, FloatArray]:
    """(u, v) of texels, row 0 at the top."""
    line = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(line, 1.0 - line)
    return u, v


def all_triangles(mesh: Mesh, side: int = SIDE) -> NDArray[np.int32]:
    """(R, R) the triangle that holds each texel's centre, by trying every one near it."""
    u, v = centres(side)
    columns, rows = u[0], v[:, 0]
    found = np.full((side, side), len(mesh.faces), np.int32)
    for number, corners in enumerate(mesh.triangle_uv()):
        low, high = corners.min(axis=0) - 1e-9, corners.max(axis=0) + 1e-9
        across = np.flatnonzero((columns >= low[0]) & (columns <= high[0]))
        down = np.flatnonzero((rows >= low[1]) & (rows <= high[1]))
        near = np.ix_(down, across)
        points = np.stack([u[near], v[near]], axis=-1).reshape(-1, 2)
        a, b, c = corners
        weights = np.linalg.solve(np.stack([b - a, c - a], axis=1), (points - a).T)
        inside = (weights > -1e-9).all(axis=0) & (weights.sum(axis=0) < 1 + 1e-9)
        found[near] = np.where(inside.reshape(found[near].shape), number, found[near])
    return found


def fine_normals(surface: Surface, height: Surface, side: int = SIDE, cut: int = 8) -> FloatArray:
    """(R, R, 3) in double: the surface moved along its own normal, as a mesh `cut` times as fine as
    the texels, and the mean normal of the four quads around each centre."""
    step = 1.0 / (side * cut)
    u, v = centres(side)

    def moved(du: int, dv: int) -> FloatArray:
        a, b = u + du * step, v + dv * step
        return surface(a, b) + height(a, b)[..., None] * true_normals(surface, a, b)

    across, up = moved(1, 0) - moved(-1, 0), moved(0, 1) - moved(0, -1)
    return unit(np.cross(across, up))


def tangents(surface: Surface, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """dP/du and dP/dv."""
    step = 1e-5
    along = surface(u + step, v) - surface(u - step, v)
    across = surface(u, v + step) - surface(u, v - step)
    return along / (2 * step), across / (2 * step)


def true_normals(surface: Surface, u: FloatArray, v: FloatArray) -> FloatArray:
    return unit(np.cross(*tangents(surface, u, v)))


def unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between unit vectors."""
    chord = np.linalg.norm(a - b, axis=-1)
    found: FloatArray = np.degrees(2 * np.arcsin((chord / 2).clip(0, 1)))
    return found
