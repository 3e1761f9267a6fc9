"""Stiffness at the places that take stretch: wrinkles and pores, and texels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.vectors import VECTOR


def stiffness_of_elements(
    stiffness: Stiffness | None,
    mesh: Mesh,
    uv: NDArray[np.float32],
    triangle: NDArray[np.int32],
) -> NDArray[np.float32] | None:
    """(P,) at elements with their centres at (P, 2), UDIM offset included; None without a map.

    triangle: (P,) that each samples. An element whose centre lies outside of its triangle, beyond
    a border or a seam, takes the point of the triangle that is closest: the skin that moves it. One
    in no triangle is 1.
    """
    if stiffness is None:
        return None
    points = uv.astype(np.float64)
    held = triangle < len(mesh.faces)
    points[held] = _closest(points[held], mesh.triangle_uv()[triangle[held]])
    found = np.ones(len(points), np.float32)
    for udim in stiffness.maps:
        local = points - udim_origin(udim)
        inside = held & ((local >= 0) & (local < 1)).all(axis=1)
        found[inside] = stiffness.at(udim, local[inside])
    return found


def stiffness_of_texels(
    device: Device, stiffness: Stiffness | None, udim: int, side: int, row: int, column: int,
    count: int,
) -> Buffer | None:  # fmt: skip
    """float32 of count² texels of a level of `side` texels, with room for a VECTOR; None where all
    of them are 1."""
    found = None if stiffness is None else stiffness.texels(udim, side, row, column, count)
    if found is None:
        return None
    return device.upload(np.resize(found, max(found.size, VECTOR)))


def _closest(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 2) the point of each triangle (P, 3, 2) that is closest: the point itself inside."""
    edges = np.roll(corners, -1, axis=1) - corners
    gaps = points[:, None] - corners
    turn = edges[..., 0] * gaps[..., 1] - edges[..., 1] * gaps[..., 0]
    inside = np.logical_or((turn >= 0).all(axis=1), (turn <= 0).all(axis=1))
    length2 = np.maximum((edges**2).sum(axis=-1), np.finfo(np.float64).tiny)
    along = np.clip((edges * gaps).sum(axis=-1) / length2, 0.0, 1.0)
    feet = corners + along[..., None] * edges
    nearest = ((feet - points[:, None]) ** 2).sum(axis=-1).argmin(axis=1)
    foot = np.take_along_axis(feet, nearest[:, None, None], axis=1)[:, 0]
    return np.where(inside[:, None], points, foot)
