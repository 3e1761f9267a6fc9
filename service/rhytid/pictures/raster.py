"""Which triangle covers each pixel: the ground of every picture of a mesh or of its UV map."""

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
    weights = _barycentric(points[triangle], x + 0.5, y + 0.5)
    inside = (weights >= -1e-12).all(axis=1)
    triangle, weights, pixel = triangle[inside], weights[inside], (y * width + x)[inside]
    near = np.zeros(len(triangle)) if depth is None else -np.sum(weights * depth[triangle], axis=1)
    order = np.lexsort((triangle, near, pixel))
    found, first = np.unique(pixel[order], return_index=True)
    visible = order[first]
    index = np.full(height * width, -1, np.int64)
    blend = np.zeros((height * width, 3))
    index[found], blend[found] = triangle[visible], weights[visible]
    return Coverage(index.reshape(height, width), blend.reshape(height, width, 3))


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
    corners: NDArray[np.float64], x: NDArray[Any], y: NDArray[Any]
) -> NDArray[np.float64]:
    """(N, 3) coordinates of the points; a triangle without area contains nothing."""
    a, b, c = (corners[:, i] for i in range(3))
    area = _cross(b - a, c - a)
    point = np.stack([x, y], axis=-1)
    divisor = np.where(area == 0, 1.0, area)
    at_b = _cross(point - a, c - a) / divisor
    at_c = _cross(b - a, point - a) / divisor
    result = np.stack([1 - at_b - at_c, at_b, at_c], axis=-1)
    return np.where(area[:, None] == 0, -1.0, result)


def _cross(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
