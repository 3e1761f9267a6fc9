"""Where the texels of one UDIM lie on the mesh: found once an asset, the same for every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.errors import MeshError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Chart:
    """The triangles (R, R) of the texels of a UDIM, row 0 at the top.

    covered (R, R): which texels show a triangle, padding included; the others have that of the
    nearest one that does.  islands (F,): the part of the UV layout that each triangle is of.
    uv_edges (F, 3, 2): first corner, local to the UDIM, and the two edges from it.
    """

    triangles: NDArray[np.int32]
    covered: NDArray[np.bool_]
    islands: IntArray
    uv_edges: FloatArray

    @classmethod
    def of(cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> Chart:
        """From what the service finds: the number of triangles stands for none."""
        corners = mesh.triangle_uv() - np.array(udim_origin(udim), np.float64)
        first = corners[:, 0]
        edges = np.stack([first, corners[:, 1] - first, corners[:, 2] - first], axis=1)
        covered = triangles < len(mesh.faces)
        return cls(_filled(triangles, covered), covered, _islands(mesh), edges)

    def corner_weights(self, rows: slice, where: NDArray[np.bool_]) -> FloatArray:
        """(K, 3) barycentric weights of those texels of some rows that `where` names, in their
        triangles; outside of its triangle a texel has those of a point on its border."""
        side = len(self.triangles)
        row, column = np.nonzero(where)
        found = self.triangles[rows][where]
        u = (column + 0.5) / side
        v = 1.0 - (row + rows.start + 0.5) / side
        a, b, c = np.moveaxis(self.uv_edges[found], 1, 0)
        x, y = u - a[:, 0], v - a[:, 1]
        area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
        second = (x * c[:, 1] - y * c[:, 0]) / area
        third = (y * b[:, 0] - x * b[:, 1]) / area
        weights = np.stack([1.0 - second - third, second, third], axis=1).clip(0.0, None)
        scaled: FloatArray = weights / weights.sum(axis=1, keepdims=True)
        return scaled


def _filled(triangles: NDArray[np.int32], covered: NDArray[np.bool_]) -> NDArray[np.int32]:
    if covered.all():
        return triangles
    if not covered.any():
        raise MeshError("no texel shows a triangle: the resolution is too low for these UV")
    nearest = ndimage.distance_transform_edt(~covered, return_distances=False, return_indices=True)
    found: NDArray[np.int32] = triangles[tuple(nearest)]
    return found


def _islands(mesh: Mesh) -> IntArray:
    """(F,) numbers of parts of the UV layout: triangles that share texture coordinates."""
    _, uv = np.unique(mesh.uv, axis=0, return_inverse=True)
    corner = uv.reshape(-1)[mesh.face_uv]
    pairs = np.concatenate([corner[:, :2], corner[:, 1:]])
    size = len(mesh.uv)
    joined = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), (size, size))
    _, parts = connected_components(joined, directed=False)
    found: IntArray = parts[corner[:, 0]].astype(np.int64)
    return found
