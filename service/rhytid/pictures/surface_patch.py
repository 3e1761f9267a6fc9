"""Square patches of a mesh, seen along the surface normal at their middle, with their relief."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import triangles_inside, udim_origin
from rhytid.pictures.images import BACKGROUND, Picture, downsample, to_picture
from rhytid.pictures.raster import Coverage, rasterize, vertex_normals
from rhytid.pictures.relief import flat_light, lit, spline_samples, spline_slopes

# Sides that a triangle may lie in front of the middle of a patch or behind it.
_DEPTH = 1.0
# The largest exposure where the form of the mesh shows: parts that face the light must not clip.
_FORM_EXPOSURE = 1.2
# Share of the light that comes from the upper right where the form shows.
_FILL = 0.25
# Of a whole mesh: its picture over its largest side, light in degrees, what is drawn for a pixel
# and along a side, and the squares along a side that are drawn one by one.
_MARGIN, _WHOLE_LIGHT, _SUPERSAMPLING, _SQUARES = 1.04, 45.0, 2, 4


@dataclass(frozen=True, eq=False)
class Frame:
    """The place and the axes from which a patch is seen.

    origin: (3,).  axes: (3, 3), rows right, up, to the viewer.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]

    @classmethod
    def at(cls, origin: NDArray[Any], normal: NDArray[Any]) -> Frame:
        """The frame of a tangent plane. Up is world y projected into the plane, or world z where
        the normal is ±y."""
        n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
        upright = np.array([0.0, 1.0, 0.0]) if abs(n[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
        right = np.cross(upright, n)
        right /= np.linalg.norm(right)
        return cls(np.asarray(origin, np.float64), np.stack([right, np.cross(n, right), n]))

    @classmethod
    def of(cls, triangle: NDArray[Any]) -> Frame:
        """The frame of the tangent plane in the middle of a triangle (3, 3)."""
        a, b, c = np.asarray(triangle, np.float64)
        return cls.at((a + b + c) / 3, np.cross(b - a, c - a))

    def carried(self, neutral: NDArray[Any], deformed: NDArray[Any]) -> Frame:
        """The frame turned with a triangle (3, 3), without its stretch: both stay comparable."""
        before, after = _basis(neutral), _basis(deformed)
        left, _, right = np.linalg.svd(after @ np.linalg.inv(before))
        turn = left @ np.diag((1.0, 1.0, np.linalg.det(left @ right))) @ right
        return Frame(np.asarray(deformed, np.float64).mean(axis=0), self.axes @ turn.T)

    def local(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """(…, 3) coordinates: right, up, to the viewer."""
        result: NDArray[np.float64] = (np.asarray(points, np.float64) - self.origin) @ self.axes.T
        return result


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """The pixels of a patch on its mesh.

    seen: (P, P) triangles among those near the patch.  uv: (P, P, 2), 0 where nothing is seen.
    by_uv: (N, 2, 2) of those triangles: takes ∂h/∂(u, v) to the gradient on the surface, its plane
    laid into that of the picture.  form: (P, P, 3) smooth normals in the frame, of the bare mesh.
    depth: (P, P) before the plane of the frame.
    """

    seen: Coverage
    uv: NDArray[np.float64]
    by_uv: NDArray[np.float64]
    form: NDArray[np.float64]
    depth: NDArray[np.float64]

    def heights(self, displacement: NDArray[Any]) -> NDArray[np.float64]:
        """(P, P) heights of a map (R, R), row 0 at the top, through a cubic B-spline; 0 beside the
        mesh."""
        values = spline_samples(displacement, *self._texels(len(displacement)))
        return np.where(self.seen.covered, values, 0.0)

    def gradient(self, displacement: NDArray[Any]) -> NDArray[np.float64]:
        """(P, P, 2) slope of the map on the surface, right and up; 0 beside the mesh."""
        size = len(displacement)
        down, across = spline_slopes(displacement, *self._texels(size))
        by_uv = np.stack([across, -down], axis=-1) * size
        slopes = np.einsum("hwij,hwj->hwi", self.by_uv[self.seen.triangle], by_uv)
        return np.where(self.seen.covered[..., None], slopes, 0.0)

    def picture(self, displacement: NDArray[Any], elevation: float, form: bool = False) -> Picture:
        """(P, P, 3) the relief under light from the upper left, white beside the mesh.

        elevation: of the light over the tangent plane, degrees.  form: bend the normals of the mesh
        itself, not those of a flat sheet; weaker light from the upper right keeps the side that is
        turned away from being black.
        """
        normals = self.form.copy() if form else np.tile((0.0, 0.0, 1.0), (*self.uv.shape[:2], 1))
        normals[..., :2] -= self.gradient(displacement)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
        light, exposure = flat_light(elevation)
        if form:
            exposure, filling = min(exposure, _FORM_EXPOSURE), (-light[0], *light[1:])
            colour = (1.0 - _FILL) * lit(normals, light, exposure)
            colour += _FILL * lit(normals, filling, exposure)
        else:
            colour = lit(normals, light, exposure)
        return to_picture(np.where(self.seen.covered[..., None], colour, BACKGROUND))

    def _texels(self, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Fractional rows and columns (P, P)."""
        return (1 - self.uv[..., 1]) * size - 0.5, self.uv[..., 0] * size - 0.5


def surface_patch(
    corners: NDArray[Any],
    triangle_uv: NDArray[Any],
    frame: Frame,
    side: float,
    pixels: int,
    normals: NDArray[Any] | None = None,
    deep: float | None = None,
) -> SurfacePatch:
    """A square of `side` mesh units around the origin of a frame, seen orthographically along it.

    corners: (F, 3, 3).  triangle_uv: (F, 3, 2) local to the UDIM of the maps.  normals: (F, 3, 3)
    smooth ones at the corners; without them, those of the triangles.

    The nearest triangle that faces the viewer is visible. Triangles more than `deep` before or
    behind the plane, usually a side, are left out.
    """
    local = frame.local(corners)
    near = _near(local, side, _DEPTH * side if deep is None else deep)
    around = None if normals is None else np.asarray(normals, np.float64)[near] @ frame.axes.T
    uv = np.asarray(triangle_uv, np.float64)[near]
    return _patch(local[near], uv, around, side, pixels)


def _patch(
    local: NDArray[np.float64],
    uv: NDArray[np.float64],
    around: NDArray[np.float64] | None,
    side: float,
    pixels: int,
) -> SurfacePatch:
    """As `surface_patch`, of the triangles near it and their normals, both in its frame."""
    flat = _unit(np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0]))
    if around is None:
        around = np.repeat(flat[:, None], 3, axis=1)
    points = local[..., :2] * (1, -1) * (pixels / side) + pixels / 2
    seen = rasterize(points, pixels, pixels, local[..., 2])
    form, depth = _unit(seen.smooth(around)), seen.smooth(local[..., 2:])[..., 0]
    return SurfacePatch(seen, seen.smooth(uv), _by_uv(local, uv, flat), form, depth)


def whole_picture(
    mesh: Mesh, positions: NDArray[Any], maps: Iterable[tuple[int, NDArray[Any]]], pixels: int
) -> Picture:
    """(pixels, pixels, 3) a whole mesh with its relief, seen from +z, light from the upper left.

    positions: (V, 3).  maps: UDIMs and their displacement (R, R), row 0 at the top, taken one by
    one.  pixels: a multiple of _SQUARES.
    """
    fine = pixels * _SUPERSAMPLING
    normals = vertex_normals(positions, mesh.faces)
    found = np.full((fine, fine, 3), 255, np.uint8)
    nearest = np.full((fine, fine), -np.inf)
    for udim, displacement in maps:
        for where, patch in _squares(mesh, udim, positions, normals, fine):
            nearer = patch.seen.covered & (patch.depth > nearest[where])
            shown = patch.picture(displacement, _WHOLE_LIGHT, form=True)
            found[where][nearer], nearest[where][nearer] = shown[nearer], patch.depth[nearer]
    return to_picture(downsample(found / 255.0, _SUPERSAMPLING))


def _squares(
    mesh: Mesh, udim: int, positions: NDArray[Any], normals: NDArray[np.float64], pixels: int
) -> Iterator[tuple[tuple[slice, slice], SurfacePatch]]:
    """The patches of a UDIM, and their pixels in a picture of the whole mesh, of which they take
    less memory one by one than it would at once."""
    inside = triangles_inside(mesh, udim)
    faces, uv = mesh.faces[inside], mesh.triangle_uv()[inside] - udim_origin(udim)
    low, high = positions.min(axis=0), positions.max(axis=0)
    side, step = _MARGIN * float((high - low).max()), pixels // _SQUARES
    edge = side / _SQUARES
    for row, column in itertools.product(range(_SQUARES), repeat=2):
        down, right = (((n + 0.5) / _SQUARES - 0.5) * side for n in (row, column))
        local = positions[faces] - ((low + high) / 2.0 + (right, -down, 0.0))
        near = _near(local, edge, side)
        if len(near):
            rows, columns = (slice(n * step, (n + 1) * step) for n in (row, column))
            yield (rows, columns), _patch(local[near], uv[near], normals[faces[near]], edge, step)


def _near(local: NDArray[np.float64], side: float, deep: float) -> NDArray[np.int64]:
    """Triangles (N,) that reach into the box of a patch and face the viewer."""
    reach = np.array([0.5 * side, 0.5 * side, deep])
    low, high = local.min(axis=1), local.max(axis=1)
    a, b = (local[:, i, :2] - local[:, 0, :2] for i in (1, 2))
    facing = a[:, 0] * b[:, 1] > a[:, 1] * b[:, 0]
    found: NDArray[np.int64] = np.flatnonzero(
        facing & (low <= reach).all(axis=1) & (high >= -reach).all(axis=1)
    )
    return found


def _by_uv(
    local: NDArray[np.float64], uv: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """J(JᵀJ)⁻¹ with J = ∂X/∂(u, v) = E U⁻¹, turned by the least angle into the picture's plane."""
    edges, edges_uv = (np.stack([t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]], -1) for t in (local, uv))
    back = np.swapaxes(edges_uv @ np.linalg.pinv(edges, rcond=1e-9), -1, -2)
    tilt = normal[:, :2] / (1.0 + normal[:, 2:])
    result: NDArray[np.float64] = back[:, :2] - tilt[:, :, None] * back[:, 2:]
    return result


def _basis(triangle: NDArray[Any]) -> NDArray[np.float64]:
    """(3, 3), columns: two edges and the unit normal."""
    a, b, c = np.asarray(triangle, np.float64)
    return np.stack([b - a, c - a, _unit(np.cross(b - a, c - a))], axis=-1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    result: NDArray[np.float64] = vectors / np.maximum(length, 1e-300)
    return result
