"""Places of the patches of a preview: the flattest ones, or the one that the user names."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim, triangles_inside, udim_origin
from rhytid.errors import InputError, MeshError
from rhytid.meshes.nearest import closest
from rhytid.pictures.flat_patches import flattest_patches
from rhytid.pictures.surface_patch import Frame

Floats = NDArray[np.float64]
# Of the longest side of the mesh: how far a point may be from the surface that it means.
_NEAR = 0.05
# Barycentric coordinates that still count as inside, for points on an edge.
_INSIDE = -1e-9


@dataclass(frozen=True, eq=False)
class Spot:
    """A place on the surface.

    uv: (2,) within its UDIM.  frame: tangent plane.  scale: UV per mesh unit.
    """

    uv: Floats
    frame: Frame
    scale: float


@dataclass(frozen=True, eq=False)
class Spots:
    """Places in one UDIM.

    side: of a patch, mesh units.
    """

    udim: int
    side: float
    spots: tuple[Spot, ...]


def flat_spots(mesh: Mesh, sides: Sequence[float]) -> Spots:
    """Flat places for patches of the first of these sides that fits. There are none on a tiny
    mesh."""
    udim = busiest_udim(mesh)
    inside = triangles_inside(mesh, udim)
    corners = mesh.positions[mesh.faces[inside]]
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    for side in sides:
        with suppress(MeshError):
            found = flattest_patches(corners, uv, side / 2)
            spots = [
                Spot(p.uv, Frame.of(corners[p.triangle]), float(abs(np.linalg.det(p.to_uv)) ** 0.5))
                for p in found
            ]
            return Spots(udim, side, tuple(spots))
    return Spots(udim, sides[-1], ())


def spot_at(mesh: Mesh, place: Sequence[float], side: float) -> Spots:
    """The place at (u, v), whose whole parts are the UDIM, or nearest to (x, y, z) in coordinates
    of the file. Raises InputError where the surface is not there."""
    if not np.isfinite(place).all():
        raise InputError(f"--patch {_numbers(place)}: not a place")
    used = np.flatnonzero(mesh.usable_triangles())
    corners, uv = mesh.positions[mesh.faces[used]].astype(np.float64), mesh.triangle_uv()[used]
    if len(place) == 2:
        triangle, weights = _by_uv(uv, place)
    else:
        triangle, weights = _by_point(corners, np.asarray(place) - mesh.centre, place)
    a, b, c = corners[triangle]
    normal = np.cross(b - a, c - a)
    (x, y), (z, w) = uv[triangle, 1:] - uv[triangle, :1]
    at = weights @ uv[triangle]
    column, row = np.floor(uv[triangle].mean(axis=0)).astype(int)
    scale = float(np.sqrt(abs(x * w - y * z) / np.linalg.norm(normal)))
    spot = Spot(at - (column, row), Frame.at(weights @ corners[triangle], normal), scale)
    return Spots(1001 + int(column) + 10 * int(row), side, (spot,))


def _by_uv(uv: Floats, place: Sequence[float]) -> tuple[int, Floats]:
    """The first triangle of (K, 3, 2) that holds a place in UV, and barycentric coordinates
    there."""
    edges = np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2)
    share = np.linalg.solve(edges, (np.asarray(place) - uv[:, 0])[..., None])[..., 0]
    weights = np.concatenate([1.0 - share.sum(axis=1, keepdims=True), share], axis=1)
    inside = np.flatnonzero((weights >= _INSIDE).all(axis=1))
    if not len(inside):
        raise InputError(f"--patch {_numbers(place)}: no triangle of the mesh is there in UV")
    return int(inside[0]), weights[inside[0]]


def _by_point(corners: Floats, point: Floats, place: Sequence[float]) -> tuple[int, Floats]:
    """The triangle nearest to a point, and barycentric coordinates of its nearest point."""
    landing = closest(corners, point[None])
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    distance = float(landing.distance[0])
    if not distance <= _NEAR * size:
        rule = f"it is {distance:.4g} mesh units away from the mesh, {size:.4g} across"
        raise InputError(f"--patch {_numbers(place)}: {rule}")
    return int(landing.triangle[0]), landing.weights[0]


def _numbers(place: Sequence[float]) -> str:
    return " ".join(f"{number:g}" for number in place)
