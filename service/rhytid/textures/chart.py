"""The points of the mesh under the texels of one UDIM: found once per asset, the same in every
frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

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
T = TypeVar("T", bound=np.generic)
# Texels that are worked on at once: some 40 doubles each.
TEXELS = 1 << 18
# Of a barycentric weight: the device looks up with UV that are rounded to float32.
_ROUNDED = 1e-4


@dataclass(frozen=True, eq=False)
class Chart:
    """The triangles (R, R) of the texels of a UDIM, row 0 at the top.

    covered (R, R): which texels show a triangle, padding included; the others have that of the
    nearest one that does.  inside (R, R): which have their centre in their triangle.  nearest
    (R, R): the number of the nearest one inside, row by row.  islands (F,): the part of the UV
    layout that each triangle is of.  uv_edges (F, 3, 2): first corner, local to the UDIM, and the
    two edges from it.
    """

    triangles: NDArray[np.int32]
    covered: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    nearest: NDArray[np.int32]
    islands: IntArray
    uv_edges: FloatArray

    @classmethod
    def of(cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> Chart:
        """From what the service finds: the number of triangles stands for none. Raises MeshError
        where no texel shows one."""
        edges = local_edges(mesh, udim)
        covered = triangles < len(mesh.faces)
        if not covered.any():
            raise MeshError(f"no texel of UDIM {udim} shows a triangle: the resolution is too low")
        filled = triangles.reshape(-1)[_nearest(covered)]
        inside = texels_inside(filled, edges) & covered
        # Triangles that all lie between the centres of texels.
        inside = inside if inside.any() else covered
        return cls(filled, covered, inside, _nearest(inside), _islands(mesh), edges)

    def padded(self, values: NDArray[T]) -> NDArray[T]:
        """(R, R, ...) whose texels outside of the islands have what the nearest one inside has."""
        found: NDArray[T] = values.reshape(-1, *values.shape[2:])[self.nearest]
        return found

    def corner_weights(self, rows: slice, where: NDArray[np.bool_]) -> FloatArray:
        """(K, 3) barycentric weights of those texels of some rows that `where` names, in their
        triangles; outside of its triangle a texel has those of a point on its border."""
        weights = _barycentric(self.triangles, self.uv_edges, rows, where).clip(0.0, None)
        scaled: FloatArray = weights / weights.sum(axis=1, keepdims=True)
        return scaled


def local_edges(mesh: Mesh, udim: int) -> FloatArray:
    """(F, 3, 2): the first corner of each triangle, local to a UDIM, and the two edges from it."""
    corners = mesh.triangle_uv() - np.array(udim_origin(udim), np.float64)
    first = corners[:, 0]
    return np.stack([first, corners[:, 1] - first, corners[:, 2] - first], axis=1)


def _barycentric(
    triangles: NDArray[np.int32], uv_edges: FloatArray, rows: slice, where: NDArray[np.bool_]
) -> FloatArray:
    """(K, 3) of those texels of some rows that `where` names; negative outside of a triangle."""
    side = len(triangles)
    row, column = np.nonzero(where)
    a, b, c = np.moveaxis(uv_edges[triangles[rows][where]], 1, 0)
    x = (column + 0.5) / side - a[:, 0]
    y = 1.0 - (row + rows.start + 0.5) / side - a[:, 1]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    area[area == 0.0] = np.nan  # such a triangle holds no texel
    second = (x * c[:, 1] - y * c[:, 0]) / area
    third = (y * b[:, 0] - x * b[:, 1]) / area
    return np.stack([1.0 - second - third, second, third], axis=1)


def texels_inside(triangles: NDArray[np.int32], uv_edges: FloatArray) -> NDArray[np.bool_]:
    """(R, R) which texels have their centre in their triangle (R, R)."""
    side = len(triangles)
    found = np.zeros((side, side), np.bool_)
    rows = max(TEXELS // side, 1)
    for start in range(0, side, rows):
        part = slice(start, min(start + rows, side))
        every = np.ones((part.stop - start, side), np.bool_)
        least = _barycentric(triangles, uv_edges, part, every).min(axis=1)
        found[part] = (least >= -_ROUNDED).reshape(-1, side)
    return found


def _nearest(known: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(R, R) the number of the nearest texel that is known, row by row."""
    row, column = ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    ).astype(np.int32)
    found: NDArray[np.int32] = row * np.int32(known.shape[1]) + column
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
