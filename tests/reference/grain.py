"""Relief between lines: noise of the place in space, in octaves, as much of it as texels carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array, Indices

# A code, where swells differ by region or patch and where they do not.
UNEVEN_STEP, STEP = 1 / 16, 1 / 32
CELLS = 2  # of the noise to a wave: half of its power is in waves of 1.9 cells and longer
TURN = np.array([[0.0, 0.8, 0.6], [-0.8, 0.36, -0.48], [-0.6, -0.48, 0.64]])


@dataclass(frozen=True)
class Octaves:
    """finer: each than the one before.  inverted: seeds count from the complement."""

    finer: float
    shares: tuple[float, ...]
    inverted: bool = False

    def seed(self, seed: int, octave: int) -> int:
        first = seed * len(self.shares)
        return ((~first - len(self.shares) if self.inverted else first) + octave) % 2**32


GRAIN = Octaves(5**0.5, (0.898, 0.401, 0.180))
UNDULATION = Octaves(2.0, (0.739, 0.517, 0.370, 0.222), inverted=True)


def grain(
    points: Array, uv: Array, corners: Array, triangle: Indices, places: Array, size: float,
    texels: int, seed: int, octaves: Octaves = GRAIN,
) -> Array:  # fmt: skip
    """(P,) noise of root mean square 1 at points (P, 2) in UV of known triangles (P,).

    uv (F, 3, 2), corners (F, 3, 3): of the triangles.  places: (V, 3) of the whole mesh, whose
    middle is the origin.  size: the largest wavelength.  texels: a side of the map."""
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    a, b = uv[triangle], corners[triangle]
    jacobian = np.swapaxes(b[:, 1:] - b[:, :1], 1, 2) @ np.linalg.inv(
        np.swapaxes(a[:, 1:] - a[:, :1], 1, 2)
    )
    place = b[:, 0] - middle + np.einsum("pij,pj->pi", jacobian, points - a[:, 0])
    place *= CELLS / size
    texel = np.linalg.norm(jacobian, ord=2, axis=(1, 2)) / texels / size
    total = np.zeros(len(points))
    for octave, share in enumerate(octaves.shares):
        place = place @ TURN.T
        texels = octaves.finer**-octave / texel
        total += share * carried(texels) * noise(place, octaves.seed(seed, octave))
        place = place * octaves.finer
    return total


def rough(
    uv: Array, faces: Indices, points: Array, triangle: Indices, at: Indices, values: Array
) -> Array:
    """(P,) factor at points (P, 2) of known triangles (P,), linear between the vertices of these,
    which have the mean of the pores on their triangles; beyond a triangle within its corners.

    uv: (F, 3, 2).  at, values: (N,) triangle and factor of each pore."""
    means = {}
    for vertex in np.unique(faces):
        around = np.flatnonzero((faces[at] == vertex).any(axis=1))
        means[vertex] = values[around].mean()
    found = np.empty(len(points))
    for i, (point, t) in enumerate(zip(points, triangle, strict=True)):
        corners = np.vstack([uv[t].T, np.ones(3)])
        own = np.array([means[v] for v in faces[t]])
        linear = np.linalg.solve(corners, [*point, 1.0]) @ own
        found[i] = np.clip(linear, own.min(), own.max())
    return found


def carried(texels: Array) -> Array:
    """(P,) what is left of an octave, by texels to a wave: none of it below two; then as the mean
    over texels is less high than the noise itself."""
    return np.clip(texels - 2, 0, 1) / (1 + 2.2 / texels**2)


def noise(p: Array, seed: int) -> Array:
    """(P,) gradient noise at p (P, 3), divided by its own root mean square over all of space."""
    cell = np.floor(p).astype(np.int64)
    total = np.zeros(len(p))
    for step in np.ndindex(2, 2, 2):
        away = p - cell - step
        weight = fade(1 - np.abs(away)).prod(axis=1)
        total += weight * (gradients(cell + step, seed) * away).sum(axis=1)
    return total / root_mean_square()


def fade(t: ArrayLike) -> Array:
    t = np.asarray(t, np.float64)
    return t**3 * (t * (6 * t - 15) + 10)


def root_mean_square() -> float:
    """Of gradients that are even over [-1, 1]³: eight corners alike, three components of mean
    square 1/3 each, by Gauss's quadrature, which is exact for these polynomials."""
    x, w = np.polynomial.legendre.leggauss(8)
    t, w = (x + 1) / 2, w / 2
    plain, first = w @ fade(1 - t) ** 2, w @ (fade(1 - t) ** 2 * t**2)
    return float(np.sqrt(8 * 3 * plain**2 * first / 3))


def gradients(cell: Indices, seed: int) -> Array:
    """(P, 3) in [-1, 1): the first three words of pcg4d, as signed fractions."""
    words = [*(cell % 2**32).astype(np.uint32).T, np.full(len(cell), seed, np.uint32)]
    x, y, z, w = (v * np.uint32(1664525) + np.uint32(1013904223) for v in words)
    for _ in range(2):
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
        x, y, z, w = (v ^ (v >> np.uint32(16)) if _ == 0 else v for v in (x, y, z, w))
    return np.stack([x, y, z], axis=1).view(np.int32) / 2.0**31


def gain(log_ratios: Array, exponent: float, stiffness: ArrayLike = 1.0) -> Array:
    """(...) how much of the neutral's grain shows; log_ratios (..., 2)."""
    logs = log_ratios * np.asarray(stiffness)[..., None]
    return np.clip(np.exp(-exponent * logs), 0.25, 4).mean(axis=-1)


def shown(heights: Array, noise: Array, gain: Array, amplitude: float, depth: float) -> Array:
    """Heights with grain; less of it in furrows."""
    return heights + amplitude * noise * gain * np.clip(1 + heights / depth, 0.25, 1)
