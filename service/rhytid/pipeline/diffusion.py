"""Smooths values on a surface by a length, however fine its mesh is: diffusion of heat."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

FloatArray = NDArray[np.float64]
# Implicit steps: the more there are the closer what one place spreads into is to a Gaussian.
STEPS = 3
# Of the mean: vertices without area take part, and give nothing.
_LEAST_MASS = 1e-9
# Cotangents of slivers, which would tie two vertices together beyond what double can hold.
_MOST_COTANGENT = 1e3
# Conjugate gradients end where what is left is this share of what is asked for.
_RESIDUAL, _MOST_ROUNDS = 1e-6, 1000


class Diffusion:
    """The surface of a mesh, ready to smooth values at its vertices.

    Values diffuse as heat does, u' = Δu for the time sigma²/2, by backward Euler steps with the
    Laplacian of cotangents; negative ones count as 0, so that nothing overshoots. Nothing crosses
    the rim, sums by area stay.

    sigma: the length, mesh units.  one (V,): equal numbers, 0 to C - 1, for vertices that are one.
    """

    def __init__(self, mesh: Mesh, sigma: float, one: NDArray[np.integer]) -> None:
        """sigma: standard deviation of the smoothing, mesh units.  one (V,): equal numbers for
        vertices that move as one, as those that an exporter has split at UV seams."""
        self._mesh, self.one, self.sigma = mesh, one, sigma
        self._faces = one[mesh.faces]
        corners = mesh.positions.astype(np.float64)[mesh.faces]
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._area = triangle_areas(corners)
        self._count = int(one.max()) + 1
        mass = self._summed(np.repeat(self._area / 3.0, 3))
        self._mass = np.maximum(mass, _LEAST_MASS * float(mass.mean()))
        time = 0.5 * sigma**2 / STEPS
        laplacian = _laplacian(corners, self._faces, self._count)
        self._matrix = (scipy.sparse.diags(self._mass) + time * laplacian).tocsr()

    def narrower(self, share: float) -> Diffusion:
        """The same surface, ready to smooth by a share of the length."""
        return Diffusion(self._mesh, share * self.sigma, self.one)

    def of_triangles(self, values: NDArray[Any]) -> FloatArray:
        """(V, K) smoothed values at vertices, from values (F, K) of triangles, averaged by area."""
        share = values * (self._area / 3.0)[:, None]
        sums = [self._summed(np.repeat(column, 3)) for column in share.T]
        return self._spread(np.stack(sums, axis=-1) / self._mass[:, None])

    def of_vertices(self, values: NDArray[Any]) -> FloatArray:
        """(V, K) smoothed values, from values (V, K); vertices that are one take their mean."""
        count = np.bincount(self.one, minlength=self._count)
        sums = [np.bincount(self.one, weights=v, minlength=self._count) for v in values.T]
        return self._spread(np.stack(sums, axis=-1) / np.maximum(count, 1)[:, None])

    @property
    def normals(self) -> FloatArray:
        """(V, 3) unit normals, outward: means of the triangles around each vertex, by area."""
        corners = np.repeat(self._normals, 3, axis=0)
        sums = np.stack([self._summed(column) for column in corners.T], axis=-1)
        sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300)
        found: FloatArray = sums[self.one]
        return found

    @property
    def edges(self) -> NDArray[np.integer]:
        """(3F, 2) the sides of the triangles, by the numbers of `one`."""
        return np.concatenate([self._faces[:, (k, (k + 1) % 3)] for k in range(3)])

    def as_one(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(C,) by the numbers of `one`: whether some vertex of each is chosen (V,)."""
        found = np.zeros(self._count, np.bool_)
        found[self.one[chosen]] = True
        return found

    def bent(self, share: float) -> FloatArray:
        """(V,) the sum of both curvatures of the surface, in one over a mesh unit, smoothed by a
        share of the length; above 0 where it is bent outwards as a ball is."""
        narrow = self.narrower(share)
        places = self._mesh.positions.astype(np.float64)
        places -= places.mean(axis=0)
        sunk = (places - narrow.of_vertices(places)) * self.normals
        # u' = Δu: a surface sinks by its curvature times the time.
        found: FloatArray = sunk.sum(axis=1) / (0.5 * narrow.sigma**2)
        return found

    def _spread(self, values: FloatArray) -> FloatArray:
        for _ in range(STEPS):
            values = _solved(self._matrix, self._mass[:, None] * values, values)
        found: FloatArray = values[self.one]
        return found

    def _summed(self, corners: FloatArray) -> FloatArray:
        faces = self._faces.ravel()
        sums = np.bincount(faces, weights=corners, minlength=self._count)
        return sums.astype(np.float64, copy=False)


def triangle_areas(corners: FloatArray) -> FloatArray:
    """(F,) areas of triangles with corners (F, 3, 3)."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area: FloatArray = 0.5 * np.linalg.norm(np.cross(one, two), axis=-1)
    return area


def _laplacian(
    corners: FloatArray, faces: NDArray[np.integer], count: int
) -> scipy.sparse.csr_matrix:
    """(C, C) positive semidefinite, rows sum to 0."""
    rows, columns, weights = [], [], []
    for k in range(3):
        here, one, two = (corners[:, (k + j) % 3] for j in range(3))
        a, b = one - here, two - here
        twice = np.linalg.norm(np.cross(a, b), axis=-1)
        cotangent = (a * b).sum(-1) / np.maximum(twice, 1e-300)
        weights.append(0.5 * np.clip(cotangent, 0.0, _MOST_COTANGENT))
        rows.append(faces[:, (k + 1) % 3])
        columns.append(faces[:, (k + 2) % 3])
    i, j, w = np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)
    off = scipy.sparse.coo_matrix(
        (np.tile(-w, 2), (np.r_[i, j], np.r_[j, i])), shape=(count, count)
    ).tocsr()
    return off - scipy.sparse.diags(np.asarray(off.sum(axis=1)).ravel())


def _solved(matrix: scipy.sparse.csr_matrix, right: FloatArray, start: FloatArray) -> FloatArray:
    """(C, K) with matrix · found = right: conjugate gradients after Jacobi, columns at once."""
    inverse = 1.0 / matrix.diagonal()[:, None]
    found, rest = start, right - matrix @ start
    way = inverse * rest
    left = (rest * way).sum(axis=0)
    enough = _RESIDUAL**2 * (right * inverse * right).sum(axis=0)
    for _ in range(_MOST_ROUNDS):
        if (left <= enough).all():
            break
        ahead = matrix @ way
        step = left / np.maximum((way * ahead).sum(axis=0), 1e-300)
        found = found + step * way
        rest -= step * ahead
        better = inverse * rest
        now = (rest * better).sum(axis=0)
        way = better + now / np.maximum(left, 1e-300) * way
        left = now
    return found
