"""Which triangle covers each pixel: the base of every picture of a mesh or of its UV map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
        """(H, W) true where a triangle is visible."""
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
    """Cover pixels with triangles.

    corners: (F, 3, 2) pixel coordinates (x right, y down; pixel centres at +½).
    depth: (F, 3); the greatest is visible, the lowest index on ties. Absent: the lowest index.
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
    """Cover the texels of one UDIM's map, row 0 at the top; triangle_uv: (F, 3, 2), v up."""
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
