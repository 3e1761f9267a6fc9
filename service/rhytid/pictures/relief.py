"""Displacement as it looks on skin: crops of a map at true scale, and relief shading of heights
(Fig. 2, right).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.flat_patches import FlatPatch
from rhytid.pictures.images import Picture, to_picture

LIGHT = (-0.55, 0.60, 0.58)
_ALBEDO = np.array([0.66, 0.645, 0.63])
_AMBIENT, _DIFFUSE = 0.22, 0.95
_BROAD, _TIGHT = (0.16, 7), (0.10, 45)


def relief(
    height: NDArray[Any],
    texel: float | tuple[float, float],
    light: tuple[float, float, float] = LIGHT,
    exaggeration: float = 1.0,
) -> Picture:
    """A picture (H, W, 3) of a height field lit by one distant light, seen from above.

    height: (H, W), row 0 at the top.  texel: the distance of two texels on the surface, in the
    unit of `height`; a pair is (across, down).  light: direction to the light, x right, y up,
    z to the viewer.  exaggeration: multiplies the height.
    """
    return to_picture(lit(height_normals(height, texel, exaggeration), light))


def flat_light(elevation: float) -> tuple[tuple[float, float, float], float]:
    """Light from the upper left, and the exposure that shows a flat sheet as bright as at 45°.

    elevation: over the plane of the picture, degrees, above 0.
    """
    angle = math.radians(elevation)
    across = math.cos(angle) * math.sqrt(0.5)
    return (-across, across, math.sin(angle)), math.sqrt(0.5) / math.sin(angle)


def lit(
    normals: NDArray[Any], light: tuple[float, float, float] = LIGHT, exposure: float = 1.0
) -> NDArray[np.float64]:
    """(H, W, 3) sRGB of skin with unit normals (H, W, 3) under one distant light.

    exposure: multiplies the direct light, not the ambient light.
    """
    to_light = np.array(light) / np.linalg.norm(light)
    half = to_light + np.array([0.0, 0.0, 1.0])
    facing = np.clip(normals @ to_light, 0, None)
    mirror = np.clip(normals @ (half / np.linalg.norm(half)), 0, None)
    gloss = sum(strength * mirror**power for strength, power in (_BROAD, _TIGHT))
    colour: NDArray[np.float64] = _ALBEDO * (_AMBIENT + exposure * _DIFFUSE * facing)[..., None]
    colour += gloss[..., None]
    return colour


def height_normals(
    height: NDArray[Any], texel: float | tuple[float, float], exaggeration: float = 1.0
) -> NDArray[np.float64]:
    """(H, W, 3) unit normals: x right, y up, z to the viewer, by central differences."""
    across, down = texel if isinstance(texel, tuple) else (texel, texel)
    by_row, by_column = np.gradient(np.asarray(height, np.float64) * exaggeration, down, across)
    normals = np.stack([-by_column, by_row, np.ones_like(by_row)], axis=-1)
    result: NDArray[np.float64] = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    return result


def surface_crop(
    displacement: NDArray[Any], patch: FlatPatch, side: float, pixels: int, deformed: bool
) -> NDArray[np.float64]:
    """(pixels, pixels) heights on a square of `side` mesh units around a patch; the spacing is side
    / pixels.

    displacement: (R, R), row 0 at the top.  deformed: measure `side` on the deformed surface, so
    that stretched skin shows less of the map.
    """
    along = ((np.arange(pixels) + 0.5) / pixels - 0.5) * side
    x, y = np.meshgrid(along, -along)
    to_uv = patch.to_uv @ np.linalg.inv(patch.shape) if deformed else patch.to_uv
    u, v = (patch.uv[i] + to_uv[i, 0] * x + to_uv[i, 1] * y for i in (0, 1))
    size = len(displacement)
    return spline_samples(displacement, (1 - v) * size - 0.5, u * size - 0.5)


def spline_samples(
    values: NDArray[Any], row: NDArray[np.float64], column: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The values of a cubic B-spline over (H, W) at fractional positions; the border is repeated.

    It is twice differentiable, so that shading shows neither texels nor facets. It does not pass
    through the texels: it smooths by about half a texel (its variance is 1/3 texel²).
    """
    r, c = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    return _weighted(values, r, c, _weights(row - r), _weights(column - c))


def spline_slopes(
    values: NDArray[Any], row: NDArray[np.float64], column: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The derivatives of `spline_samples` by row and by column, per texel."""
    r, c = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    down = _weighted(values, r, c, _slopes(row - r), _weights(column - c))
    return down, _weighted(values, r, c, _weights(row - r), _slopes(column - c))


def _weighted(
    values: NDArray[Any],
    r: NDArray[np.int64],
    c: NDArray[np.int64],
    by_row: list[NDArray[np.float64]],
    by_column: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Sums over 4 x 4 texels from (r - 1, c - 1) on; the border is repeated."""
    result = np.zeros(r.shape)
    for i in range(4):
        y = np.clip(r + i - 1, 0, values.shape[0] - 1)
        for j in range(4):
            x = np.clip(c + j - 1, 0, values.shape[1] - 1)
            result += by_row[i] * by_column[j] * values[y, x]
    return result


def _weights(t: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [
        (1 - t) ** 3 / 6,
        (4 + t * t * (3 * t - 6)) / 6,
        (1 + t * (3 + t * (3 - 3 * t))) / 6,
        t**3 / 6,
    ]


def _slopes(t: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Derivatives of the weights."""
    return [-((1 - t) ** 2) / 2, t * (3 * t - 4) / 2, (1 + t * (2 - 3 * t)) / 2, t * t / 2]
