"""Reliefs of known lines and pores, and what the kernels of tracing compute, in float64."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from reference.inputs import Array


def line_profile(t: Array, bulge: float) -> Array:
    """Depth over that of the middle at distances t from a line, in half widths."""
    t2 = np.minimum(t**2, 1.0)
    return (1.0 - t2) ** 2 * (1.0 - bulge * t2)


def relief_of_lines(
    side: int, lines: Array, half_width: float, depth: float, bulge: float
) -> Array:
    """(side, side) of segments (L, 4), x and y of both ends in texels, y down; the deepest counts,
    and so does the highest."""
    y, x = np.mgrid[:side, :side].astype(np.float64)
    deep, high = np.zeros((side, side)), np.zeros((side, side))
    for x0, y0, x1, y1 in lines:
        ex, ey = x1 - x0, y1 - y0
        s = np.clip(((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
        profile = line_profile(np.hypot(x - x0 - s * ex, y - y0 - s * ey) / half_width, bulge)
        deep, high = np.maximum(deep, profile), np.maximum(high, -profile)
    return depth * (high - deep)


def relief_of_pores(side: int, centres: Array, radius: float, depth: float) -> Array:
    """(side, side) of pores at (P, 2), x and y in texels, y down; the deepest counts."""
    y, x = np.mgrid[:side, :side].astype(np.float64)
    deep = np.zeros((side, side))
    for cx, cy in centres:
        t2 = np.minimum(((x - cx) ** 2 + (y - cy) ** 2) / radius**2, 1.0)
        deep = np.maximum(deep, (1.0 - t2) ** 2)
    return -depth * deep


def derivatives(relief: Array, taps: Array) -> tuple[Array, ...]:
    """x, y, xx, xy, yy of a relief, by taps (3, n) of the orders 0, 1 and 2; borders go on."""

    def of(down: int, right: int) -> Array:
        rows = correlate1d(relief, taps[right], axis=1, mode="nearest")
        return correlate1d(rows, taps[down], axis=0, mode="nearest")

    return of(0, 1), of(1, 0), of(0, 2), of(1, 1), of(2, 0)


def curvatures(xx: Array, xy: Array, yy: Array) -> tuple[Array, Array, Array]:
    """Larger and smaller eigenvalue of the Hessian, and the direction (..., 2) of the larger."""
    matrices = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    values, vectors = np.linalg.eigh(matrices)
    return values[..., 1], values[..., 0], vectors[..., :, 1]


def wrinkle_height(
    x: Array, y: Array, segment: Array, size: Array, slope: Array, shape: tuple[float, ...]
) -> Array:
    """Height in depths of one wrinkle at places, y down: its narrow layer and its broad one added.

    segment: start and extent.  size: logarithms of the half widths at both ends, then weights.
    slope: of the arc, to the left with y up.  shape: bulge, least half width, share and width of
    the broad layer, and how much of that is there.
    """
    bulge, least, broad, wider, fade = shape
    (x0, y0, ex, ey), length = segment, np.hypot(segment[2], segment[3])
    along = ((x - x0) * ex + (y - y0) * ey) / length**2
    s = np.clip(along, 0.0, 1.0)
    arc = length * (slope[0] * s * (1 - s) ** 2 - slope[1] * s**2 * (1 - s))
    aside = (ey * (x - x0) - ex * (y - y0)) / length - arc
    away = np.hypot(aside, (along - s) * length)
    true = np.exp(size[0]) * (1 - s) + np.exp(size[1]) * s
    width, weight = np.maximum(true, least), size[2] * (1 - s) + size[3] * s
    narrow = line_profile(away / width, bulge) * true / width
    swell = (1.0 - np.minimum((away / (width * wider)) ** 2, 1.0)) ** 2
    return -weight * ((1.0 - broad) * narrow + broad * fade * swell)


def pore_height(x: Array, y: Array, centre: Array, root: Array, size: float) -> Array:
    """Height in depths of a pore of weight 1 at places, y down.  root: (xx, xy, yy), y up, of size
    1.  size: logarithm of how many times as large it is."""
    dx, dy = x - centre[0], centre[1] - y
    t = np.hypot(root[0] * dx + root[1] * dy, root[2] * dy) / np.exp(size)
    return -((1.0 - np.minimum(t**2, 1.0)) ** 2)
