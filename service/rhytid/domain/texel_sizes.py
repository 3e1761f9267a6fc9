"""How large texels are on the surface of a mesh, and where they are too large or too small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.warnings import TEXEL_PLACE, TEXEL_RATIO, TEXEL_TAIL

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TexelSpread:
    """Sides of texels on the surface, mesh units, without the tails: the least, the usual and the
    most.

    coarse: the most are farther off the usual than the least.  worst: of the triangles that are
    farthest off, the one that is largest in space.  more: how many places more are beyond
    TEXEL_RATIO, each of triangles that touch one another and of TEXEL_PLACE of the area or more."""

    least: float
    usual: float
    most: float
    coarse: bool
    worst: int
    more: int


def texel_spread(
    area: FloatArray, area_uv: FloatArray, faces: NDArray[np.int32], resolution: int
) -> TexelSpread | None:
    """Of triangles (F, 3) of these areas in space and UV; None where no texel is too large or too
    small."""
    side = texel_sides(area, area_uv, resolution)
    least, usual, most = side[texel_extremes(side, area)].tolist()
    if most <= TEXEL_RATIO * least:
        return None
    # Seen from the usual texel: what is farther off, skin that is too coarse or too fine.
    coarse = most / usual >= usual / least
    farthest = side >= most if coarse else side <= least
    worst = int(np.argmax(np.where(farthest, area, -1.0)))
    beyond = side > TEXEL_RATIO * least if coarse else side < most / TEXEL_RATIO
    beyond[worst] = True
    chosen = np.flatnonzero(beyond)
    place = _places(faces[chosen])
    sizes = np.bincount(place, weights=area[chosen])
    sizes[place[np.searchsorted(chosen, worst)]] = 0.0
    more = int(np.count_nonzero(sizes >= TEXEL_PLACE * area.sum()))
    return TexelSpread(least, usual, most, coarse, worst, more)


def texel_sides(area: FloatArray, area_uv: FloatArray, resolution: int) -> FloatArray:
    """(F,) sides of texels on the surface, mesh units, in triangles of these areas."""
    sides: FloatArray = np.sqrt(area / area_uv) / resolution
    return sides


def texel_extremes(side: FloatArray, area: FloatArray) -> NDArray[np.intp]:
    """(3,) the triangles with the least, the median and the most of sides (F,), by area (F,),
    TEXEL_TAIL of it at either end left out."""
    order = np.argsort(side)
    shares = np.cumsum(area[order])
    tails = np.array([TEXEL_TAIL, 0.5, 1.0 - TEXEL_TAIL])
    found: NDArray[np.intp] = order[np.searchsorted(shares, tails * shares[-1])]
    return found


def usual_uv_length(mesh: Mesh) -> float:
    """Mesh units that a step of 1 in UV is long in its longest direction: the median over the area
    in space."""
    used = mesh.usable_triangles()
    a, b, c = np.moveaxis(mesh.positions[mesh.faces[used]].astype(np.float64), 1, 0)
    uv = mesh.triangle_uv()[used]
    edges, edges_uv = np.stack([b - a, c - a], axis=2), np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2)
    jacobian = edges @ np.linalg.inv(edges_uv)
    (e, f), (_, g) = np.moveaxis(np.swapaxes(jacobian, 1, 2) @ jacobian, 0, 2)
    longest = np.sqrt((e + g) / 2 + np.hypot((e - g) / 2, f))
    order = np.argsort(longest)
    shares = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1)[order])
    return float(longest[order[np.searchsorted(shares, 0.5 * shares[-1])]])


def _places(faces: NDArray[np.int32]) -> NDArray[np.intp]:
    """(F,) the lowest number of a vertex that each triangle hangs together with."""
    label = np.arange(int(faces.max()) + 1)
    while True:
        least = label[faces].min(axis=1)
        lower = label.copy()
        np.minimum.at(lower, faces, least[:, None])
        lower = lower[lower]
        if np.array_equal(lower, label):
            return label[faces[:, 0]]
        label = lower
