"""The UV vertices of a mesh: its vertices, each once for every place that it has in UV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

# Jacobians in units of their mean. Beyond these, squares would leave float32.
_LEAST_JACOBIAN, _MOST_JACOBIAN = 1e-15, 1e15
# Of |J s|² found as sᵀGs in float32, in units of the trace of G; and the least that is taken, which
# is LEAST_DETERMINANT of smooth.clh.
_ROUNDING, LEAST_SPEED2 = 2e-6, 1e-10


@dataclass(frozen=True)
class UvVertices:
    """W UV vertices, and the triangles that each is a mean of.

    vertex (W,): of the mesh.  corners (F, 3): the UV vertices of each triangle.
    offsets (W + 1,), members, shares: the triangles of each UV vertex and their shares of the
    neutral area around it, which sum to 1; none for a UV vertex without triangles of use.
    """

    vertex: NDArray[np.int32]
    corners: NDArray[np.int32]
    offsets: NDArray[np.int32]
    members: NDArray[np.int32]
    shares: NDArray[np.float32]

    @classmethod
    def of(cls, mesh: Mesh, used: NDArray[np.bool_]) -> UvVertices:
        """The UV vertices of a mesh; only triangles `used` (F,) count in means."""
        vertex, corners = _welded(mesh)
        around = triangles_around(corners, used, _areas(mesh), len(vertex))
        return cls(vertex.astype(np.int32), corners.astype(np.int32), *around)

    def slowest(self, jacobians: NDArray[np.float32]) -> NDArray[np.float64]:
        """(F,) the least √(sᵀGs) that float32 finds for unit s, G interpolated in each triangle.

        G is the mean of JᵀJ at each UV vertex, 1 where it has no triangles.
        """
        count, matrices = len(self.vertex), jacobians.reshape(-1, 2, 2).astype(np.float64)
        own = (np.swapaxes(matrices, 1, 2) @ matrices)[self.members] * self.shares[:, None, None]
        without = np.diff(self.offsets) == 0
        owner = np.repeat(np.arange(count), np.diff(self.offsets))
        entries = [np.bincount(owner, own[:, i, j], count) for i, j in ((0, 0), (0, 1), (1, 1))]
        uu, uv, vv = (np.where(without, one, x) for x, one in zip(entries, (1, 0, 1), strict=True))
        # The least eigenvalue of a mean is no less than the least of them.
        least = (0.5 * (uu + vv) - np.hypot(0.5 * (uu - vv), uv))[self.corners].min(axis=1)
        trace = (uu + vv)[self.corners]
        floor = LEAST_SPEED2 * trace.min(axis=1)
        bound: NDArray[np.float64] = np.maximum(least - _ROUNDING * trace.max(axis=1), floor)
        return np.sqrt(bound)


def unit_jacobians(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.bool_], float]:
    """(F, 4) J = ∂X/∂(u, v) of each neutral triangle in a frame of its plane, row by row, in units
    of the mesh's mean; (F,) which triangles have one that float32 can square; and the mean."""
    usable = mesh.usable_triangles()
    edges_uv, edges = _edges(mesh.triangle_uv()), _edges(mesh.positions[mesh.faces])
    edges_uv[~usable] = np.eye(2)
    length = np.where(usable, np.linalg.norm(edges[:, :, 0], axis=1), 1.0)
    along = np.sum(edges[:, :, 0] * edges[:, :, 1], axis=1) / length
    across = np.linalg.norm(np.cross(edges[:, :, 0], edges[:, :, 1]), axis=1) / length
    plane = np.stack([length, along, np.zeros_like(length), across], axis=1).reshape(-1, 2, 2)
    jacobians = (plane @ np.linalg.inv(edges_uv)).reshape(-1, 4)
    size = np.linalg.norm(jacobians, axis=1)
    area = _areas(mesh)[usable]
    mean = np.sqrt(0.5 * np.average((size[usable] / size[usable].max()) ** 2, weights=area))
    mean *= size[usable].max()
    used = usable & (size > _LEAST_JACOBIAN * mean) & (size < _MOST_JACOBIAN * mean)
    units = np.where(used[:, None], jacobians / mean, 0.0).astype(np.float32)
    return units, used, float(mean)


def _welded(mesh: Mesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(W,) the vertex of each UV vertex, and (F, 3) the UV vertices of each triangle."""
    _, place = np.unique(mesh.uv + 0.0, axis=0, return_inverse=True)  # -0 is 0
    places = int(place.max()) + 1
    pairs = mesh.faces.astype(np.int64) * places + place.reshape(-1)[mesh.face_uv]
    welded, corners = np.unique(pairs, return_inverse=True)
    return welded // places, corners.reshape(-1, 3)


def triangles_around(
    corners: NDArray[np.integer],
    used: NDArray[np.bool_],
    areas: NDArray[np.float64],
    count: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Offsets (count + 1,), members and shares of means over the triangles around each corner: the
    triangles, in order, and their shares of the area, which sum to 1.

    corners (F, 3): numbers of corners.  used (F,): triangles that count.  areas (F,): in any unit.
    """
    owner, members = corners[used].reshape(-1), np.repeat(np.flatnonzero(used), 3)
    order = np.argsort(owner, kind="stable")
    owner, members = owner[order], members[order]
    area = areas[members]
    offsets = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))])
    shares = area / np.bincount(owner, area, count)[owner]
    return offsets.astype(np.int32), members.astype(np.int32), shares.astype(np.float32)


def _areas(mesh: Mesh) -> NDArray[np.float64]:
    """(F,) areas in space, of the largest; the rule of each share is a ratio."""
    edges = _edges(mesh.positions[mesh.faces])
    edges /= np.abs(edges).max()
    areas: NDArray[np.float64] = np.linalg.norm(np.cross(edges[:, :, 0], edges[:, :, 1]), axis=1)
    return areas


def _edges(corners: NDArray[np.floating]) -> NDArray[np.float64]:
    """(F, k, 2) the two edges from the first corner, as columns."""
    wide = corners.astype(np.float64)
    return np.stack([wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0]], axis=2)
