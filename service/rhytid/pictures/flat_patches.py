"""Patches of a mesh that are small enough to be taken as flat: those that an expression stretches
and compresses most, and the flattest ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import MeshError
from rhytid.pictures.raster import rasterize_uv

_CANDIDATES = 1500
_LOG_LIMIT = 0.5
_COVERAGE_SIZE = 512
_FACING = 0.45
# Half a crop's diagonal, on skin compressed to two thirds.
_REACH = 2.1


@dataclass(frozen=True, eq=False)
class FlatPatch:
    """A patch of the surface.

    centre: (3,) on the neutral surface.  triangle: the one it lies in.  uv: (2,).
    to_uv: (2, 2), uv per mesh unit along the tangent axes x (right) and y (up) of the patch.
    log_stretch: (2, 2) symmetric, the mean of log ρᵢ q̂ᵢq̂ᵢᵀ over the patch, in those axes.
    """

    centre: NDArray[np.float64]
    triangle: int
    uv: NDArray[np.float64]
    to_uv: NDArray[np.float64]
    log_stretch: NDArray[np.float64]

    @property
    def principal(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """ρ (2,), the stronger change first, and the angles (2,) of their axes, radians, y up."""
        values, vectors = np.linalg.eigh(self.log_stretch)
        order = np.argsort(-np.abs(values))
        return np.exp(values[order]), np.arctan2(vectors[1, order], vectors[0, order])

    @property
    def shape(self) -> NDArray[np.float64]:
        """(2, 2) the deformation of the patch by the expression, without its rotation."""
        values, vectors = np.linalg.eigh(self.log_stretch)
        result: NDArray[np.float64] = (vectors * np.exp(values)) @ vectors.T
        return result


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Triangles (F,) as samples of a surface and of its stretch.

    centre, normal: (F, 3).  area: (F,).  uv: (F, 3, 2).
    jacobian: (F, 3, 2), ∂X/∂(u, v).  tensor: (F, 3, 3), Σ log ρᵢ q̂ᵢq̂ᵢᵀ, clamped.
    """

    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    area: NDArray[np.float64]
    uv: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    tensor: NDArray[np.float64]


def most_stretched_patches(
    corners: NDArray[Any],
    triangle_uv: NDArray[Any],
    axes: NDArray[Any],
    ratios: NDArray[Any],
    radius: float,
) -> tuple[FlatPatch, FlatPatch]:
    """The most stretched and the most compressed patch that face the viewer.

    corners: (F, 3, 3) neutral.  triangle_uv: (F, 3, 2) local to the UDIM.  axes: (F, 2, 2).
    ratios: (F, 2).  radius: of a patch, mesh units; its square must lie inside the UV chart.
    Raises MeshError where no patch of that size fits.
    """
    triangles = _triangles(corners, triangle_uv, axes, ratios)
    chosen = _candidates(triangles, radius)
    tensors, flatness = _means(triangles, chosen, radius)
    values = np.linalg.eigvalsh(tensors) * flatness[:, None]
    most, least = int(np.argmax(values[:, 2])), int(np.argmin(values[:, 0]))
    stretched = _patch(triangles, int(chosen[most]), tensors[most])
    return stretched, _patch(triangles, int(chosen[least]), tensors[least])


def flattest_patches(
    corners: NDArray[Any], triangle_uv: NDArray[Any], radius: float
) -> tuple[FlatPatch, ...]:
    """The flattest patch of a mesh at rest that faces the viewer, and the flattest of those far
    from it, if any.

    corners: (F, 3, 3).  triangle_uv: (F, 3, 2) local to the UDIM.  radius: of a patch, mesh units.
    Raises MeshError where no patch of that size fits.
    """
    rest = np.ones((len(corners), 2))
    triangles = _triangles(corners, triangle_uv, np.tile(np.eye(2), (len(corners), 1, 1)), rest)
    chosen = _candidates(triangles, radius)
    tensors, flatness = _means(triangles, chosen, radius)
    first = int(np.argmax(flatness))
    away = np.linalg.norm(triangles.centre[chosen] - triangles.centre[chosen[first]], axis=1)
    far = away >= max(0.5 * away.max(), 3.0 * radius)
    second = [int(np.argmax(np.where(far, flatness, -1.0)))] if far.any() else []
    return tuple(_patch(triangles, int(chosen[i]), tensors[i]) for i in (first, *second))


def _triangles(
    corners: NDArray[Any], uv: NDArray[Any], axes: NDArray[Any], ratios: NDArray[Any]
) -> _Triangles:
    x, t = np.asarray(corners, np.float64), np.asarray(uv, np.float64)
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2
    edges_uv = np.stack([t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]], axis=-1)
    usable = (np.abs(np.linalg.det(edges_uv)) > 1e-14) & (area > 0)
    edges_uv[~usable] = np.eye(2)
    edges = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=-1)
    jacobian = edges @ np.linalg.inv(edges_uv)
    along = np.einsum("fcu,fiu->fic", jacobian, axes)
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-30)
    logs = np.clip(np.log(np.maximum(ratios, 1e-6)), -_LOG_LIMIT, _LOG_LIMIT)
    tensor = np.einsum("fi,fic,fid->fcd", logs, along, along)
    unit = normal / np.maximum(2 * area[:, None], 1e-30)
    return _Triangles(x.mean(axis=1), unit, np.where(usable, area, 0.0), t, jacobian, tensor)


def _candidates(p: _Triangles, radius: float) -> NDArray[np.int64]:
    """Triangles around which the reach of a crop is covered by the chart and faces the viewer."""
    covered = rasterize_uv(p.uv, _COVERAGE_SIZE).covered
    missing = np.pad(np.cumsum(np.cumsum(~covered, axis=0), axis=1), ((1, 0), (1, 0)))
    reach = (
        _REACH * radius / np.maximum(np.linalg.norm(p.jacobian, axis=(1, 2)) / np.sqrt(2), 1e-30)
    )
    centre = p.uv.mean(axis=1)
    low = np.floor((centre - reach[:, None]) * _COVERAGE_SIZE).astype(np.int64)
    high = np.ceil((centre + reach[:, None]) * _COVERAGE_SIZE).astype(np.int64)
    inside = ((low >= 0) & (high <= _COVERAGE_SIZE)).all(axis=1) & (p.area > 0)
    inside &= p.normal[:, 2] > _FACING
    found: NDArray[np.int64] = np.flatnonzero(inside)
    top, bottom = _COVERAGE_SIZE - high[found, 1], _COVERAGE_SIZE - low[found, 1]
    left, right = low[found, 0], high[found, 0]
    holes = (
        missing[bottom, right] - missing[top, right] - missing[bottom, left] + missing[top, left]
    )
    found = found[holes == 0]
    if not len(found):
        raise MeshError(f"no patch of radius {radius:g} lies inside the UV chart and faces +z")
    return found[:: max(1, len(found) // _CANDIDATES)]


def _means(
    p: _Triangles, chosen: NDArray[np.int64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean tensors (C, 3, 3) of the patches by area, and how flat each patch is, 0…1."""
    tensors, flatness = np.empty((len(chosen), 3, 3)), np.empty(len(chosen))
    for i, triangle in enumerate(chosen):
        near = np.sum((p.centre - p.centre[triangle]) ** 2, axis=1) <= radius * radius
        near[triangle] = True
        weight = p.area[near] / p.area[near].sum()
        tensors[i] = np.einsum("f,fcd->cd", weight, p.tensor[near])
        flatness[i] = np.linalg.norm(weight @ p.normal[near]) ** 8
    return tensors, flatness


def _patch(p: _Triangles, triangle: int, tensor: NDArray[np.float64]) -> FlatPatch:
    normal = p.normal[triangle]
    right = np.cross((0.0, 1.0, 0.0), normal)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(normal, right)])
    to_uv = np.linalg.inv(frame @ p.jacobian[triangle])
    uv = p.uv[triangle].mean(axis=0)
    return FlatPatch(p.centre[triangle], triangle, uv, to_uv, frame @ tensor @ frame.T)
