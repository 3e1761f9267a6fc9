"""The mesh as a surface to put pores on: areas, normals and Jacobians, and points on it.

Triangles that nothing can be drawn on carry no pores: those whose UV are stretched too far, and
those that other charts cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh, boxes
from rhytid.errors import MeshError
from rhytid.support import cancellation

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
AnyFloats = TypeVar("AnyFloats", bound=NDArray[Any])
Rows = TypeVar("Rows", bound="DataclassInstance")
UDIM_COLUMNS = 10.0
# Normals around a vertex whose mean is shorter than this say nothing of where it faces.
_CANCELLED = 1e-3
# A pore whose UV is this much larger than that of the median would cover a region of the map.
_LARGEST = 100.0
# Beyond this ratio of the singular values float32 cannot hold the metric of a pore.
_NARROWEST = 500.0
# How many triangles around a centre are looked at: the one below is among the nearest unless it
# is very much larger.
_NEIGHBOURS = 8
# Triangles that are looked at together for whether they cover a centre; the cells, and the centres,
# that each may have to look at on average; how far a centre may lie outside by rounding, in UV.
_AT_ONCE, _CELLS, _EDGE = 1 << 16, 64, 1e-9


@dataclass(frozen=True, eq=False)
class Points:
    """Points on a surface: triangle (N,), uv (N, 2), position (N, 3), unit normal (N, 3).

    Of pores these are int32, float32, float64 and float32.
    """

    triangle: NDArray[np.integer]
    uv: NDArray[np.floating]
    position: FloatArray
    normal: NDArray[np.floating]

    def __len__(self) -> int:
        return len(self.triangle)

    def take(self, index: BoolArray | IntArray) -> Points:
        """The points of an index or a mask, in its order."""
        return taken(self, index)


def joined(parts: Sequence[Rows]) -> Rows:
    """Dataclasses whose fields are arrays with a row for each of their things, as one."""
    names = [field.name for field in fields(parts[0])]
    return type(parts[0])(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


def taken(rows: Rows, index: BoolArray | IntArray) -> Rows:
    """Such a dataclass with the rows of an index or a mask, in its order."""
    return type(rows)(*(getattr(rows, field.name)[index] for field in fields(rows)))


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh scaled by a power of two, so that the part which carries pores has area 1/2 to 2.

    A power of two rounds nothing, so that no part of the mesh changes with the others.

    corners (F, 3, 3), normals (F, 3, 3) of the corners, uv (F, 3, 2).
    jacobian (F, 3, 2): dX/d(u, v); zero where the triangle has no area in space or in UV.
    density (F,): sqrt(det JᵀJ), surface area per UV area.
    narrowest (F,): the smaller singular value of J, surface length per UV length.
    carries (F,): the triangles that may hold pores.  stretched: how many hold none because their
    UV is stretched beyond reason.  scale: mesh units per unit of this surface.
    area (F,): of the triangles that carry pores; 0 of others.
    """

    corners: FloatArray
    normals: FloatArray
    uv: FloatArray
    jacobian: FloatArray
    density: FloatArray
    narrowest: FloatArray
    carries: BoolArray
    stretched: int
    scale: float
    area: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> Surface:
        """Measure a mesh in float64. Raises MeshError where no triangle can carry a pore."""
        positions = mesh.positions.astype(np.float64)
        corners, uv = positions[mesh.faces], mesh.triangle_uv()
        area = 0.5 * np.linalg.norm(_facing(corners), axis=-1)
        usable = mesh.usable_triangles()
        jacobian = _jacobians(corners, uv, usable)
        density, narrowest = _singular_values(jacobian)
        inside = usable & _overlaps_udims(uv) & ~_covered_by_others(uv, usable)
        carries = inside & ~_too_stretched(density, narrowest, np.where(inside, area, 0.0))
        if not carries.any():
            raise MeshError("no triangle in u 0 to 10, v above 0 has a UV that can carry pores")
        scale = float(np.exp2(np.rint(0.5 * np.log2(area[carries].sum()))))
        return cls(
            corners=corners / scale,
            normals=_corner_normals(corners, mesh.faces),
            uv=uv,
            jacobian=jacobian / scale,
            density=density / scale**2,
            narrowest=narrowest / scale,
            carries=carries,
            stretched=int(np.count_nonzero(inside & ~carries)),
            scale=scale,
            area=np.where(carries, area, 0.0) / scale**2,
        )

    @cached_property
    def extent(self) -> FloatArray:
        """(2, 3) the least and the most coordinates of the triangles that carry pores."""
        corners = self.corners[self.carries].reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def along(self, triangle: NDArray[np.integer], direction: NDArray[np.floating]) -> FloatArray:
        """(N, 3) J·d: the surface vectors of UV vectors (N, 2) in their triangles."""
        vectors: FloatArray = np.einsum("nxc,nc->nx", self.jacobian[triangle], direction)
        return vectors

    def barycentric(self, triangle: NDArray[np.integer], uv: NDArray[np.floating]) -> FloatArray:
        """(N, 3) barycentric coordinates of uv (N, 2) in their triangles."""
        corners = self.uv[triangle]
        one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        offset, area = uv - corners[:, 0], cross(one, two)
        shares = np.empty((len(triangle), 3))
        shares[:, 1], shares[:, 2] = cross(offset, two) / area, cross(one, offset) / area
        shares[:, 0] = 1.0 - shares[:, 1] - shares[:, 2]
        return shares

    def place(self, triangle: NDArray[np.integer], uv: NDArray[np.floating]) -> FloatArray:
        """(N, 3) positions of uv (N, 2) in the planes of their triangles."""
        offset = self.along(triangle, uv - self.uv[triangle, 0])
        positions: FloatArray = self.corners[triangle, 0] + offset
        return positions


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of vectors in UV, (..., 2) each."""
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def unit(vectors: AnyFloats) -> AnyFloats:
    """Vectors of length one, in their own precision; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    length[length == 0] = 1.0
    directions: AnyFloats = vectors / length
    return directions


def _jacobians(
    corners: NDArray[np.float64], uv: NDArray[np.float64], usable: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(F, 3, 2) from corners (F, 3, 3) and uv (F, 3, 2); zero where not usable."""
    sides = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    uv_sides = (uv[:, 1:] - uv[:, :1]).transpose(0, 2, 1)
    result: NDArray[np.float64] = np.zeros_like(sides)
    result[usable] = sides[usable] @ np.linalg.inv(uv_sides[usable])
    return result


def _singular_values(
    jacobian: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(F,) the product of the two singular values, sqrt(det JᵀJ), and (F,) the smaller one."""
    u, v = jacobian[:, :, 0], jacobian[:, :, 1]
    product = np.linalg.norm(np.cross(u, v), axis=-1)
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    larger = np.sqrt(0.5 * (uu + vv) + np.hypot(0.5 * (uu - vv), uv))
    return product, product / np.where(larger > 0, larger, 1.0)


def _too_stretched(
    density: NDArray[np.float64], narrowest: NDArray[np.float64], area: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(F,) true where a pore would be `_LARGEST` times the median's, or a needle.

    density, narrowest: the results of `_singular_values`.  The median is by `area` (F,) on the
    surface.
    """
    order = np.argsort(density, kind="stable")
    half = np.searchsorted(np.cumsum(area[order]), 0.5 * area.sum())
    typical = np.sqrt(density[order[min(half, len(order) - 1)]])
    result: NDArray[np.bool_] = narrowest * _LARGEST < typical
    return result | (density > _NARROWEST * narrowest**2)


def _covered_by_others(uv: NDArray[np.float64], usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(F,) true where the centre of a triangle, uv (F, 3, 2), lies in one of a lower index.

    The lowest index wins a place in the map: what a covered triangle carried would be drawn over
    the winner's wrinkles.
    """
    index = np.flatnonzero(usable)
    centres = uv[index].mean(axis=1)
    if not _may_cover(centres, uv[index]):  # most meshes: and SciPy's trees take long to import
        return np.zeros(len(uv), bool)
    import scipy

    near = scipy.spatial.cKDTree(centres).query(
        centres, k=min(_NEIGHBOURS, len(index)), workers=-1
    )[1]
    result = np.zeros(len(uv), bool)
    for other in near.reshape(len(index), -1).T:
        cancellation.check()
        result[index] |= (other < np.arange(len(index))) & _inside(centres, uv[index[other]])
    return result


def _may_cover(centres: FloatArray, corners: FloatArray) -> bool:
    """Whether any centre (N, 2) lies in another triangle (N, 3, 2) than its own. True without
    looking where triangles are so unequal that it would take long."""
    side = max(int(np.sqrt(len(centres))), 1)
    low, size = centres.min(axis=0), np.maximum(np.ptp(centres, axis=0), 1e-300)

    def cell(points: FloatArray) -> NDArray[np.int64]:
        """(N, 2) the square of a grid of side² that holds a point, or the nearest."""
        found: NDArray[np.int64]
        found = np.clip((points - low) / size * side, 0, side - 1).astype(np.int64)
        return found

    number = cell(centres) @ np.array([1, side])
    order = np.argsort(number, kind="stable")
    # The place in `order` of the first centre of each square.
    starts = np.zeros(side * side + 1, np.int64)
    np.cumsum(np.bincount(number, minlength=side * side), out=starts[1:])
    for start in range(0, len(centres), _AT_ONCE):
        cancellation.check()
        own = np.arange(start, min(start + _AT_ONCE, len(centres)))
        least, most = boxes(corners[own])
        least, most = least - _EDGE, most + _EDGE
        first, last = cell(least), cell(most)
        rows = last[:, 1] - first[:, 1] + 1
        if rows.sum() > _CELLS * len(own):
            return True
        of, row = _counted(rows)
        row = (row + first[of, 1]) * side
        begin = starts[row + first[of, 0]]
        count = starts[row + last[of, 0] + 1] - begin
        if count.sum() > _CELLS * len(own):
            return True
        which, step = _counted(count)
        point, of = order[begin[which] + step], of[which]
        for axis in range(2):
            at = centres[point, axis]
            near = (at >= least[of, axis]) & (at <= most[of, axis]) & (point != own[of])
            point, of = point[near], of[near]
        if _inside(centres[point], corners[own[of]]).any():
            return True
    return False


def _counted(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The place of each count as often as it says, and the numbers from 0 on beside it."""
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - (np.cumsum(counts) - counts)[which]


def _inside(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) true where a point (N, 2) lies within its triangle (N, 3, 2), not on the edge."""
    sides, to = np.roll(corners, -1, axis=1) - corners, points[:, None] - corners
    turn = np.sign(cross(sides, to))
    inside: NDArray[np.bool_] = np.abs(turn.sum(axis=1)) == 3
    return inside


def _facing(corners: FloatArray) -> FloatArray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _corner_normals(corners: FloatArray, faces: NDArray[np.int32]) -> FloatArray:
    """(F, 3, 3) unit normals: the mean of the triangles around a vertex by area; that of the
    triangle where these cancel out, as they do where both sides of a sheet share its vertices."""
    facing = _facing(corners)
    around = np.column_stack([facing, np.linalg.norm(facing, axis=-1)])
    weights = np.repeat(around, 3, axis=0).T
    sums = np.stack([np.bincount(faces.ravel(), weights=w) for w in weights], axis=-1)
    left, total = np.linalg.norm(sums[:, :3], axis=-1), sums[:, 3]
    cancel = (left < _CANCELLED * total)[faces][..., None]
    return np.where(cancel, unit(facing)[:, None], unit(sums[:, :3])[faces])


def _overlaps_udims(uv: FloatArray) -> BoolArray:
    low, high = boxes(uv)
    overlaps: BoolArray = (high > 0).all(axis=-1) & (low[:, 0] < UDIM_COLUMNS)
    return overlaps
