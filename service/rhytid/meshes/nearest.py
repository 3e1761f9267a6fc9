"""The nearest point of a surface to each of many points, exactly, by trimesh and scipy; and the
part of a mesh around a point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import triangles_inside

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
# Points looked at together: bounds the memory.
_ROWS = 1 << 15
_FIRST = 8


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """The points of a surface that are nearest to P given points.

    triangle (P,): the one that holds each.  weights (P, 3): its barycentric coordinates there.
    distance (P,): from the given point.
    """

    triangle: IntArray
    weights: FloatArray
    distance: FloatArray


def closest(corners: FloatArray, points: FloatArray) -> NearestPoints:
    """The points of triangles (F, 3, 3) with area that are nearest to points (P, 3); on ties, those
    of the triangle with the lowest number.

    Triangles are sorted by size into classes. A point of a triangle lies no further from its middle
    than the largest of its class reaches, so that those with far middles need not be looked at.
    """
    classes = list(_classes(corners))
    triangle, near = np.zeros(len(points), np.int64), np.zeros((len(points), 3))
    distance = np.full(len(points), np.inf)
    for start in range(0, len(points), _ROWS):
        some = slice(start, start + _ROWS)
        for members, middles, reach in classes:
            _improve(
                corners, members, middles, reach, points[some], triangle[some], near[some],
                distance[some],
            )  # fmt: skip
    weights = _barycentric(corners[triangle], near)
    weights = np.clip(weights, 0.0, 1.0)
    return NearestPoints(triangle, weights / weights.sum(axis=1, keepdims=True), distance)


def _classes(corners: FloatArray) -> Iterator[tuple[IntArray, FloatArray, float]]:
    """Triangles, their middles, and how far these reach at most; the largest class first."""
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    kind = np.floor(np.log2(reach / reach.max()))
    sizes, counts = np.unique(kind, return_counts=True)
    for size in sizes[np.argsort(-counts, kind="stable")]:
        members = np.flatnonzero(kind == size)
        yield members, middle[members], float(reach[members].max())


def _improve(
    corners: FloatArray,
    members: IntArray,
    middles: FloatArray,
    reach: float,
    points: FloatArray,
    triangle: IntArray,
    near: FloatArray,
    distance: FloatArray,
) -> None:
    """Take what is nearer among the members of a class, in place."""
    tree, left, count = scipy.spatial.cKDTree(middles), np.arange(len(points)), _FIRST
    while len(left):
        count = min(count, len(members))
        away, which = tree.query(points[left], k=[*range(1, count + 1)])
        for column in range(count):
            # Sorted by their middles: the rest of a row is farther where one is.
            open_ = np.flatnonzero(away[:, column] - reach < distance[left])
            if not len(open_):
                break
            rows, found = left[open_], members[which[open_, column]]
            place = _nearest(corners[found], points[rows])
            gap = np.linalg.norm(place - points[rows], axis=1)
            nearer = (gap < distance[rows]) | ((gap == distance[rows]) & (found < triangle[rows]))
            rows = rows[nearer]
            triangle[rows], near[rows], distance[rows] = found[nearer], place[nearer], gap[nearer]
        if count == len(members):
            return
        left = left[away[:, -1] - reach < distance[left]]
        count *= 4


def _nearest(corners: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 3) the point of each triangle that is nearest to a point."""
    from trimesh.triangles import closest_point

    found: FloatArray = closest_point(corners, points)  # type: ignore[no-untyped-call]
    return found


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    from trimesh.triangles import points_to_barycentric

    found: FloatArray = points_to_barycentric(corners, points)  # type: ignore[no-untyped-call]
    return found


def cut_around(mesh: Mesh, udim: int, point: NDArray[Any], radius: float) -> Mesh:
    """The triangles of a UDIM that lie around a point, as a mesh of their own.

    point: (3,) on the surface.  radius: mesh units. Triangles count whose middle is nearer, and of
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
    joined = scipy.sparse.coo_array((np.ones(len(a), bool), (a, b)), shape=(vertices, vertices))
    labels: NDArray[np.int32] = scipy.sparse.csgraph.connected_components(joined, directed=False)[1]
    return labels
