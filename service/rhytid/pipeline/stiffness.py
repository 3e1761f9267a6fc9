"""Stiffness at the places that take stretch: wrinkles and pores, and texels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import BORDER_SLACK, udim_origin
from rhytid.pipeline.vectors import VECTOR

# Elements whose corners and edges are in memory together: 15 MB, 33 where all are outside.
_AT_ONCE = 65536


def stiffness_of_elements(
    stiffness: Stiffness | None,
    mesh: Mesh,
    uv: NDArray[np.float32],
    triangle: NDArray[np.int32],
) -> NDArray[np.float32] | None:
    """(P,) the stiffness of elements with their centres at uv (P, 2), UDIM offset included; None
    without a map.

    triangle (P,): that each samples. An element whose centre lies outside of its triangle, beyond a
    border or a seam, takes the stiffness at the closest point of the triangle: the skin that moves
    it. An element in no triangle has 1.
    """
    if stiffness is None:
        return None
    corners = mesh.triangle_uv()
    found = np.ones(len(uv), np.float32)
    for start in range(0, len(uv), _AT_ONCE):
        held = start + np.flatnonzero(triangle[start : start + _AT_ONCE] < len(corners))
        found[held] = _of_held(stiffness, uv[held].astype(np.float64), corners[triangle[held]])
    return found


def stiffness_of_texels(
    device: Device, stiffness: Stiffness | None, udim: int, side: int, row: int, column: int,
    count: int,
) -> Buffer | None:  # fmt: skip
    """The stiffness, float32, of count² texels from (row, column) of a level of `side` texels on,
    in a buffer for a VECTOR at least; None where it is 1 throughout."""
    found = None if stiffness is None else stiffness.texels(udim, side, row, column, count)
    if found is None:
        return None
    return device.upload(np.resize(found, max(found.size, VECTOR)))


def _of_held(
    stiffness: Stiffness, points: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float32]:
    """(P,) the stiffness at points (P, 2) of triangles (P, 3, 2)."""
    points = _closest(points, corners)
    # A point on a border of UDIMs is of the one that its triangle lies in.
    inwards = corners.mean(axis=1) - points
    cells = np.floor(points + np.clip(inwards, -BORDER_SLACK, BORDER_SLACK))
    found = np.ones(len(points), np.float32)
    for udim in stiffness.maps:
        origin = udim_origin(udim)
        inside = (cells == origin).all(axis=1)
        found[inside] = stiffness.at(udim, points[inside] - origin)
    return found


def _closest(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 2) the point of each triangle (P, 3, 2) that is closest: the point itself inside."""
    edges = np.roll(corners, -1, axis=1) - corners
    gaps = points[:, None] - corners
    turn = edges[..., 0] * gaps[..., 1] - edges[..., 1] * gaps[..., 0]
    outside = ~np.logical_or((turn >= 0).all(axis=1), (turn <= 0).all(axis=1))
    found: NDArray[np.float64] = points.copy()
    found[outside] = _foot(points[outside], corners[outside], edges[outside])
    return found


def _foot(
    points: NDArray[np.float64], corners: NDArray[np.float64], edges: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(P, 2) the point on the edges of each triangle that is closest."""
    length2 = np.maximum((edges**2).sum(axis=-1), np.finfo(np.float64).tiny)
    along = np.clip((edges * (points[:, None] - corners)).sum(axis=-1) / length2, 0.0, 1.0)
    feet = corners + along[..., None] * edges
    nearest = ((feet - points[:, None]) ** 2).sum(axis=-1).argmin(axis=1)
    foot: NDArray[np.float64] = np.take_along_axis(feet, nearest[:, None, None], axis=1)[:, 0]
    return foot
