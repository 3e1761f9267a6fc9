"""J = dX/d(u, v) of each triangle, and where it is too extreme to draw on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A pore whose UV is this much larger than that of the median would cover a region of the map.
LARGEST = 100.0
# Beyond this ratio of the singular values float32 cannot hold the metric of a pore.
NARROWEST = 500.0


def jacobians(
    corners: NDArray[np.float64], uv: NDArray[np.float64], usable: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(F, 3, 2) from corners (F, 3, 3) and uv (F, 3, 2); zero where not usable."""
    sides = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    uv_sides = (uv[:, 1:] - uv[:, :1]).transpose(0, 2, 1)
    result: NDArray[np.float64] = np.zeros_like(sides)
    result[usable] = sides[usable] @ np.linalg.inv(uv_sides[usable])
    return result


def singular(jacobian: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(F,) the product of the two singular values, sqrt(det JᵀJ), and (F,) the smaller one."""
    u, v = jacobian[:, :, 0], jacobian[:, :, 1]
    product = np.linalg.norm(np.cross(u, v), axis=-1)
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    larger = np.sqrt(0.5 * (uu + vv) + np.hypot(0.5 * (uu - vv), uv))
    return product, product / np.where(larger > 0, larger, 1.0)


def absurd(
    density: NDArray[np.float64], narrowest: NDArray[np.float64], area: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(F,) true where a pore would be `LARGEST` times the median's, or a needle.

    density, narrowest: the results of `singular`.  The median is by `area` (F,) on the surface.
    """
    order = np.argsort(density, kind="stable")
    half = np.searchsorted(np.cumsum(area[order]), 0.5 * area.sum())
    typical = np.sqrt(density[order[min(half, len(order) - 1)]])
    result: NDArray[np.bool_] = narrowest * LARGEST < typical
    return result | (density > NARROWEST * narrowest**2)
