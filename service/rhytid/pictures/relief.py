"""Relief shading of a displacement crop, so that micro relief looks like skin (Fig. 2, right)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

    exposure: multiplies the direct light, not the ambient.
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
