"""Normals and tangents of a posed mesh, as renderers and MikkTSpace (http://www.mikktspace.com)
make them. All in double."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.meshes import welded

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Posed:
    """Normals, tangents and derivatives of a frame, for normal maps.

    normals (F, 3, 3): of corners, means of the triangles at a vertex by their angles, over seams
    too.  tangents (F, 3, 3): of corners, MikkTSpace's.  signs (F,): -1 where UV are mirrored.
    along, across (F, 3): of triangles, unit vectors in their plane: dP/du, and what is orthogonal
    to it on the side of dP/dv.  scale (F, 3): |dP/du|, and dP/dv along both.
    """

    normals: FloatArray
    tangents: FloatArray
    signs: FloatArray
    along: FloatArray
    across: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, mesh: Mesh, positions: NDArray[np.float32]) -> Posed:
        """The surface of a mesh in a frame with positions (V, 3)."""
        corners = positions.astype(np.float64)[mesh.faces]
        shared = joined(mesh)
        places, signs = shared.places, shared.signs
        du, dv = _derivatives(mesh, corners)
        along = unit(du)
        across = unit(dv - dot(dv, along) * along)
        scale = np.concatenate([dot(du, along), dot(dv, along), dot(dv, across)], axis=1)
        normals = vertex_normals(corners, places)
        tangents = _tangents(corners, shared, normals, along)
        return cls(normals, tangents, signs, along, across, scale)


def vertex_normals(corners: FloatArray, places: IntArray) -> FloatArray:
    """(F, 3, 3) unit normals at the corners (F, 3, 3) of triangles, whose vertices have the numbers
    (F, 3): means of the triangles at a vertex, weighted by their angles."""
    normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return _summed(normal[:, None] * _angles(corners)[..., None], places)


def _tangents(
    corners: FloatArray, joined: JoinedCorners, normals: FloatArray, along: FloatArray
) -> FloatArray:
    """As mikktspace.c: dP/du of each triangle, brought into the plane of the vertex normal, of unit
    length, weighted by the angle in that plane, summed where position, normal, UV and side agree.
    """
    flat = unit(along[:, None] - dot(along[:, None], normals) * normals)
    after, before = (np.roll(corners, -step, axis=1) - corners for step in (1, 2))
    ends = [unit(edge - dot(edge, normals) * normals) for edge in (after, before)]
    angles = np.arccos(dot(*ends).clip(-1.0, 1.0))
    weight = angles * (joined.signs != 0)[:, None, None]
    return _summed(flat * weight, joined.vertices)


@dataclass(frozen=True, eq=False)
class JoinedCorners:
    """What is the same in every frame of a mesh, and takes longer than the rest.

    places (F, 3): of corners, numbers of places in space.  vertices (F, 3): numbers of those whose
    tangent is one: place, UV and side agree.  signs (F,): of the area in UV, 0 where there is none.
    """

    places: IntArray
    vertices: IntArray
    signs: FloatArray

    @property
    def numbers(self) -> tuple[IntArray, IntArray, FloatArray]:
        """All of them."""
        return self.places, self.vertices, self.signs


_OF_MESH: WeakKeyDictionary[Mesh, JoinedCorners] = WeakKeyDictionary()


def joined(mesh: Mesh) -> JoinedCorners:
    """Kept as long as the mesh is. Threads that come at once each make the same."""
    found = _OF_MESH.get(mesh)
    if found is None:
        found = _OF_MESH[mesh] = _join(mesh)
    return found


def _join(mesh: Mesh) -> JoinedCorners:
    places = welded(mesh)[mesh.faces]
    signs = np.sign(_uv_area(mesh)[:, 0]) * mesh.triangles_with_uv()
    _, uv = np.unique(mesh.uv, axis=0, return_inverse=True)
    key = np.stack([places, uv.reshape(-1)[mesh.face_uv], np.broadcast_to(signs[:, None] > 0,
                    places.shape)], axis=-1)  # fmt: skip
    _, vertex = np.unique(key.reshape(-1, 3), axis=0, return_inverse=True)
    return JoinedCorners(places, vertex.reshape(places.shape), signs)


def _uv_area(mesh: Mesh) -> FloatArray:
    """(F, 1) twice the area of triangles in UV, with its sign."""
    uv = mesh.triangle_uv()
    (u1, v1), (u2, v2) = ((uv[:, i] - uv[:, 0]).T[..., None] for i in (1, 2))
    found: FloatArray = u1 * v2 - u2 * v1
    return found


def _derivatives(mesh: Mesh, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """dP/du and dP/dv (F, 3)."""
    uv = mesh.triangle_uv()
    (u1, v1), (u2, v2) = ((uv[:, i] - uv[:, 0]).T[..., None] for i in (1, 2))
    first, second = (corners[:, i] - corners[:, 0] for i in (1, 2))
    area = _uv_area(mesh)
    usable = np.where(area == 0.0, 1.0, area)
    du, dv = (first * v2 - second * v1) / usable, (second * u1 - first * u2) / usable
    return du, dv


def _angles(corners: FloatArray) -> FloatArray:
    after, before = (unit(np.roll(corners, -step, axis=1) - corners) for step in (1, 2))
    found: FloatArray = np.arccos(dot(after, before)[..., 0].clip(-1.0, 1.0))
    return found


def _summed(values: FloatArray, numbers: IntArray) -> FloatArray:
    """Unit sums of values (F, 3, 3) of corners with the same number (F, 3)."""
    flat, number = values.reshape(-1, 3), numbers.reshape(-1)
    parts: list[NDArray[Any]] = [np.bincount(number, flat[:, axis]) for axis in range(3)]
    sums: FloatArray = np.stack(parts, axis=1)
    return unit(sums)[numbers]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products of vectors along the last axis, (…, 1)."""
    found: FloatArray = np.sum(a * b, axis=-1, keepdims=True)
    return found


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors of length 1; zero stays zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    found: FloatArray = vectors / np.maximum(size, _TINY)
    return found
