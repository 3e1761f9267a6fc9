"""A mesh with its displacement, seen from +z: every pixel is lit with its displaced normal."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.images import BACKGROUND, Picture, downsample, to_picture
from rhytid.pictures.raster import Coverage, View, rasterize, vertex_normals
from rhytid.pictures.relief import lit, spline_samples

_SUPERSAMPLING = 2
# More from the front than on flat crops: a whole sphere is shown.
_LIGHT = (-0.42, 0.46, 0.78)


def shade_displaced(
    positions: NDArray[Any],
    faces: NDArray[Any],
    triangle_uv: NDArray[Any],
    displacement: NDArray[Any],
    size: int,
    view: View,
    exaggeration: float = 1.0,
) -> Picture:
    """A picture (size, size, 3) of a surface whose relief shows in its shading.

    positions: (V, 3).  faces: (F, 3).  triangle_uv: (F, 3, 2), local to the UDIM of the map.
    displacement: (R, R) mesh units, row 0 at the top.  exaggeration: multiplies it.
    """
    fine = size * _SUPERSAMPLING
    corners = np.asarray(positions, np.float64)[faces]
    seen = rasterize(view.pixels(corners, fine), fine, fine, corners[..., 2])
    normals = seen.smooth(vertex_normals(positions, faces)[faces])
    uv = seen.smooth(np.asarray(triangle_uv, np.float64))
    slopes = _surface_gradient(seen, corners, triangle_uv, _uv_gradient(displacement, uv))
    bent = normals - exaggeration * slopes
    bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-30)
    colour = np.where(seen.covered[..., None], lit(bent, _LIGHT), BACKGROUND)
    return to_picture(downsample(colour, _SUPERSAMPLING))


def _uv_gradient(heights: NDArray[Any], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W, 2): ∂h/∂u and ∂h/∂v at texture coordinates (H, W, 2)."""
    size = len(heights)
    down, across = np.asarray(np.gradient(np.asarray(heights, np.float64), 1.0 / size))
    row: NDArray[np.float64] = (1 - uv[..., 1]) * size - 0.5
    column: NDArray[np.float64] = uv[..., 0] * size - 0.5
    slopes = (spline_samples(across, row, column), -spline_samples(down, row, column))
    return np.stack(slopes, axis=-1)


def _surface_gradient(
    seen: Coverage, corners: NDArray[Any], triangle_uv: NDArray[Any], slopes: NDArray[Any]
) -> NDArray[np.float64]:
    """(H, W, 3): J(JᵀJ)⁻¹∇h, J = ∂X/∂(u, v) of the visible triangle; 0 where it has no area."""
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    t = np.asarray(triangle_uv, np.float64)
    edges_uv = np.stack([t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]], axis=-1)
    # J = E U⁻¹, so J(JᵀJ)⁻¹ = (J⁺)ᵀ = (U E⁺)ᵀ.
    back = np.swapaxes(edges_uv @ np.linalg.pinv(edges, rcond=1e-9), -1, -2)
    gradient = np.einsum("hwij,hwj->hwi", back[seen.triangle], slopes)
    return np.where(seen.covered[..., None], gradient, 0.0)
