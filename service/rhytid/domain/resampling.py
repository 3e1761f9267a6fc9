"""Maps at another resolution: by area where texels become fewer, cubic where they become more.

Both are separable, and done along one side after the other in doubles. Means are kept by the one,
values at the places of texels by the other; both leave a constant map as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
# Rows that are worked on at once.
_ROWS = 256


def resampled(map: NDArray[np.floating], height: int, width: int) -> NDArray[np.float32]:
    """A map (H, W) as (height, width) float32, row 0 at the top; the map itself where it has that
    size.

    By area each texel is the mean of what lies under it, whatever the ratio. Cubic is the spline of
    Catmull and Rom: it passes through the texels, and overshoots edges by up to 7 % of their
    height; beyond the outermost texels their values go on.
    """
    found: NDArray[np.floating] = map
    if found.shape[0] != height:
        found = _along_rows(found, height)
    if found.shape[1] != width:
        found = _along_rows(found.T, width).T
    return np.ascontiguousarray(found, np.float32)


def _along_rows(map: NDArray[np.floating], count: int) -> NDArray[np.float32]:
    """(count, W) of a map (H, W)."""
    out = np.empty((count, map.shape[1]), np.float32)
    resample = _means if count < len(map) else _cubic
    for start in range(0, map.shape[1], _ROWS):
        part = slice(start, start + _ROWS)
        out[:, part] = resample(map[:, part].astype(np.float64), count)
    return out


def _means(values: FloatArray, count: int) -> FloatArray:
    """(count, …) means of equal shares of values (N, …)."""
    ends = np.arange(count + 1) * (len(values) / count)
    whole = np.minimum(ends.astype(np.int64), len(values) - 1)
    rest = (ends - whole)[:, None]
    # Sums from the middle value, so that they stay small.
    middle = values.mean(axis=0)
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    np.cumsum(values - middle, axis=0, out=sums[1:])
    until = sums[whole] + rest * (values[whole] - middle)
    found: FloatArray = np.diff(until, axis=0) * (count / len(values)) + middle
    return found


def _cubic(values: FloatArray, count: int) -> FloatArray:
    """(count, …) values between values (N, …), by four of them each."""
    place = (np.arange(count) + 0.5) * (len(values) / count) - 0.5
    first = np.floor(place).astype(np.int64)
    t = (place - first)[:, None]
    weights = (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
    total = np.zeros((count, *values.shape[1:]))
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        total += weight * values[np.clip(first + offset, 0, len(values) - 1)]
    return total
