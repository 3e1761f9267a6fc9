"""A clay-like front view of a mesh: orthographic, z-buffered, softly lit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.images import BACKGROUND, Picture, blur, downsample, to_picture
from rhytid.pictures.raster import Coverage, rasterize

CLAY = (0.80, 0.775, 0.75)
_KEY = np.array([-0.48, 0.55, 0.68]) / np.linalg.norm([-0.48, 0.55, 0.68])
_FILL = np.array([0.75, 0.05, 0.66]) / np.linalg.norm([0.75, 0.05, 0.66])
_SUPERSAMPLING = 2
_HOLE = (0.10, 0.075, 0.07)


@dataclass(frozen=True)
class View:
    """What an orthographic picture shows: `height` mesh units, centred on (x, y)."""

    x: float
    y: float
    height: float

    @classmethod
    def around(cls, positions: NDArray[Any], margin: float = 0.04) -> View:
        """The square view that holds all positions (V, 3)."""
        low, high = positions.min(axis=0).astype(float), positions.max(axis=0).astype(float)
        span = max(high[0] - low[0], high[1] - low[1]) * (1 + 2 * margin)
        return cls((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, span)

    def pixels(self, positions: NDArray[Any], size: int) -> NDArray[np.float64]:
        """(…, 2) pixel coordinates in a picture of size² pixels, y down."""
        centred = np.asarray(positions, np.float64)[..., :2] - (self.x, self.y)
        return centred * (size / self.height) * (1, -1) + size / 2


def shade_mesh(
    positions: NDArray[Any],
    faces: NDArray[Any],
    size: int = 512,
    view: View | None = None,
    colours: NDArray[Any] | None = None,
) -> Picture:
    """A picture (size, size, 3) of the mesh seen from +z.

    positions: (V, 3).  faces: (F, 3).  colours: (F, 3) in 0…1, sRGB, per triangle; absent: clay.
    """
    view = view or View.around(positions)
    fine = size * _SUPERSAMPLING
    corners = np.asarray(positions, np.float64)[faces]
    seen = rasterize(view.pixels(corners, fine), fine, fine, corners[..., 2])
    normals = vertex_normals(positions, faces)[faces]
    flat = np.broadcast_to(CLAY, (len(faces), 3)) if colours is None else colours
    light = _light(seen, normals, corners[..., 2:], fine / view.height)
    strength = 1.0 if colours is None else 0.55
    lit = seen.flat(flat) * (1 - strength + strength * light[..., None])
    return to_picture(downsample(_behind(seen, lit), _SUPERSAMPLING))


def vertex_normals(positions: NDArray[Any], faces: NDArray[Any]) -> NDArray[np.float64]:
    """(V, 3) unit normals; corners weighted as in Max 1999, exact on every triangulated sphere."""
    p = np.asarray(positions, np.float64)
    normals = np.zeros_like(p)
    for corner in range(3):
        here, after, before = (p[faces[:, (corner + k) % 3]] for k in range(3))
        a, b = after - here, before - here
        length = np.sum(a * a, axis=1) * np.sum(b * b, axis=1)
        np.add.at(normals, faces[:, corner], np.cross(a, b) / np.maximum(length, 1e-300)[:, None])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return normals


def _behind(seen: Coverage, lit: NDArray[Any]) -> NDArray[np.float64]:
    """White around the mesh; dark in its openings (mesh on all four sides), such as a mouth."""
    mask = seen.covered
    opening = ~mask
    for axis in (0, 1):
        opening &= np.maximum.accumulate(mask, axis=axis)
        opening &= np.flip(np.maximum.accumulate(np.flip(mask, axis), axis=axis), axis)
    return np.where(mask[..., None], lit, np.where(opening[..., None], _HOLE, BACKGROUND))


def _light(
    seen: Coverage, normals: NDArray[Any], depth: NDArray[Any], scale: float
) -> NDArray[np.float64]:
    n = seen.smooth(normals)
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-30)
    key = np.clip(n @ _KEY, 0, None)
    fill = np.clip(n @ _FILL, 0, None)
    sky = 0.5 + 0.5 * n[..., 1]
    half = _KEY + np.array([0.0, 0.0, 1.0])
    gloss = np.clip(n @ (half / np.linalg.norm(half)), 0, None) ** 24
    diffuse = 0.74 * key + 0.16 * fill + 0.24 * sky
    open_diffuse = diffuse * _openness(seen, depth, scale)
    light: NDArray[np.float64] = 1.02 * open_diffuse**0.72 + 0.06 * gloss
    return light


def _openness(seen: Coverage, depth: NDArray[Any], scale: float) -> NDArray[np.float64]:
    """Less than 1 in hollows: how far the surface lies behind its blurred self."""
    z = seen.smooth(depth)[..., 0]
    inside = seen.covered.astype(np.float64)
    result = np.ones_like(z)
    for radius, gain in ((0.35, 0.6), (1.1, 0.2)):
        sigma = radius * scale
        mean = blur(z * inside, sigma) / np.maximum(blur(inside, sigma), 1e-6)
        result -= gain * np.clip(mean - z, -0.15, 0.6)
    return np.clip(result, 0.25, 1.12)
