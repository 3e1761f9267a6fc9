"""Which triangle covers each pixel, the base of every picture of a mesh or of its UV map; and a
clay-like front view of a mesh: orthographic, z-buffered, softly lit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.images import BACKGROUND, Picture, blur, downsample, to_picture

CLAY = (0.80, 0.775, 0.75)
_KEY = np.array([-0.48, 0.55, 0.68]) / np.linalg.norm([-0.48, 0.55, 0.68])
_FILL = np.array([0.75, 0.05, 0.66]) / np.linalg.norm([0.75, 0.05, 0.66])
_SUPERSAMPLING = 2
_HOLE = (0.10, 0.075, 0.07)


@dataclass(frozen=True, eq=False)
class Coverage:
    """The visible triangle at each pixel of a picture.

    triangle: (H, W) int64, -1 where there is none.
    weights: (H, W, 3) barycentric coordinates of the pixel's centre in that triangle.
    """

    triangle: NDArray[np.int64]
    weights: NDArray[np.float64]

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(H, W) whether a triangle is visible."""
        return self.triangle >= 0

    def flat(self, values: NDArray[Any], background: Any = 0.0) -> NDArray[np.float64]:
        """Per-triangle values (F, …) as a picture (H, W, …), `background` elsewhere."""
        picture = np.asarray(values, np.float64)[self.triangle]
        picture[~self.covered] = background
        return picture

    def smooth(self, corners: NDArray[Any], background: Any = 0.0) -> NDArray[np.float64]:
        """Per-corner values (F, 3, C), interpolated, as a picture (H, W, C)."""
        picture: NDArray[np.float64] = np.einsum(
            "hwk,hwkc->hwc", self.weights, corners[self.triangle]
        )
        picture[~self.covered] = background
        return picture


def rasterize(
    corners: NDArray[Any], height: int, width: int, depth: NDArray[Any] | None = None
) -> Coverage:
    """The triangle that is visible at each pixel.

    corners: (F, 3, 2) pixel coordinates (x right, y down; pixel centres at +½).  depth: (F, 3); the
    greatest is visible, the lowest index on ties; without it the lowest index.
    """
    points = np.asarray(corners, np.float64)
    triangle, x, y = _candidates(points, height, width)
    weights = _barycentric(points, triangle, x + 0.5, y + 0.5)
    inside = np.flatnonzero(np.minimum(np.minimum(*weights[:2]), weights[2]) >= -1e-12)
    triangle, pixel = triangle[inside], y[inside] * width + x[inside]
    blend = np.stack([w[inside] for w in weights], axis=-1)
    if depth is not None:
        near = np.einsum("nk,nk->n", blend, np.asarray(depth, np.float64)[triangle])
        nearest = np.full(height * width, -np.inf)
        np.maximum.at(nearest, pixel, near)
        front = np.flatnonzero(near == nearest[pixel])
        triangle, pixel, blend = triangle[front], pixel[front], blend[front]
    index = np.full(height * width, -1, np.int64)
    shares = np.zeros((height * width, 3))
    # Triangles rise, and the last write to a pixel stays: the lowest index is written last.
    index[pixel[::-1]], shares[pixel[::-1]] = triangle[::-1], blend[::-1]
    return Coverage(index.reshape(height, width), shares.reshape(height, width, 3))


def rasterize_uv(
    triangle_uv: NDArray[Any], size: int, udim_origin: tuple[float, float] = (0.0, 0.0)
) -> Coverage:
    """The triangle at each texel of the map of one UDIM, row 0 at the top.

    triangle_uv: (F, 3, 2), v up.
    """
    local = np.asarray(triangle_uv, np.float64) - udim_origin
    return rasterize(np.stack([local[..., 0], 1.0 - local[..., 1]], axis=-1) * size, size, size)


def _candidates(points: NDArray[Any], height: int, width: int) -> tuple[NDArray[np.int64], ...]:
    """Every (triangle, x, y) with the pixel's centre in the triangle's bounding box."""
    limit = np.array([width, height])
    low = np.clip(np.ceil(points.min(axis=1) - 0.5), 0, limit).astype(np.int64)
    high = np.clip(np.floor(points.max(axis=1) + 0.5), 0, limit).astype(np.int64)
    extent = np.maximum(high - low, 0)
    count = extent[:, 0] * extent[:, 1]
    triangle = np.repeat(np.arange(len(points)), count)
    rank = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    columns = extent[triangle, 0]
    return triangle, low[triangle, 0] + rank % columns, low[triangle, 1] + rank // columns


def _barycentric(
    corners: NDArray[np.float64], triangle: NDArray[np.int64], x: NDArray[Any], y: NDArray[Any]
) -> tuple[NDArray[np.float64], ...]:
    """Three (N,) coordinates of points in triangles (F, 3, 2); without area these hold no point."""
    a, b, c = (corners[:, i] for i in range(3))
    (bx, by), (cx, cy) = (b - a).T, (c - a).T
    area = bx * cy - by * cx
    area[area == 0] = np.nan
    right, down = x - a[triangle, 0], y - a[triangle, 1]
    at_b, at_c = (
        right * (over / area)[triangle] - down * (along / area)[triangle]
        for over, along in ((cy, cx), (-by, -bx))
    )
    return 1.0 - at_b - at_c, at_b, at_c


@dataclass(frozen=True)
class View:
    """The part of space that an orthographic picture shows: `height` mesh units, centred on (x,
    y)."""

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
