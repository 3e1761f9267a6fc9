"""A piece of a mesh around a place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import triangles_inside


def cut_around(mesh: Mesh, udim: int, point: NDArray[Any], radius: float) -> Mesh:
    """The triangles of a UDIM that lie around a point, as a mesh of their own.

    point: (3,) on the surface.  radius: mesh units; triangles count whose middle is nearer, and of
    these the part that hangs together with the nearest, so that skin across a gap is left out.
    Raises MeshError where none of them can be used.
    """
    inside = np.flatnonzero(triangles_inside(mesh, udim))
    middles = mesh.positions[mesh.faces[inside]].astype(np.float64).mean(axis=1)
    distance = np.linalg.norm(middles - point, axis=1)
    near = distance < max(radius, np.nextafter(distance.min(), np.inf))
    faces = mesh.faces[inside[near]]
    part = _parts(faces, len(mesh.positions))[faces[:, 0]]
    kept = inside[near][part == part[distance[near].argmin()]]
    used, faces = np.unique(mesh.faces[kept], return_inverse=True)
    used_uv, face_uv = np.unique(mesh.face_uv[kept], return_inverse=True)
    shape = (-1, 3)
    return Mesh(
        mesh.positions[used],
        faces.reshape(shape).astype(np.int32),
        mesh.uv[used_uv],
        face_uv.reshape(shape).astype(np.int32),
        mesh.centre,
    )


def _parts(faces: NDArray[np.int32], vertices: int) -> NDArray[np.int32]:
    """(V,) the number of the part that a vertex belongs to: those of a triangle are in one."""
    a, b = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    joined = coo_array((np.ones(len(a), bool), (a, b)), shape=(vertices, vertices))
    labels: NDArray[np.int32] = connected_components(joined, directed=False)[1]
    return labels
