"""Pictures as arrays: 8 bit RGB, (H, W, 3), row 0 at the top."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

Picture = NDArray[np.uint8]
BACKGROUND = (1.0, 1.0, 1.0)


def to_picture(colour: NDArray[Any]) -> Picture:
    """From sRGB values in 0…1, clipped; (H, W) becomes grey."""
    rgb = colour if colour.ndim == 3 else np.repeat(colour[..., None], 3, axis=-1)
    picture: Picture = (np.clip(rgb, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)
    return picture


def downsample(values: NDArray[Any], factor: int) -> NDArray[np.float64]:
    """Means over factor² pixels; the sides of (H, W, …) are multiples of `factor`."""
    height, width = values.shape[0] // factor, values.shape[1] // factor
    blocks = values.reshape(height, factor, width, factor, *values.shape[2:])
    result: NDArray[np.float64] = blocks.mean(axis=(1, 3))
    return result


def blur(values: NDArray[Any], sigma: float) -> NDArray[np.float64]:
    """Nearly Gaussian blur of (H, W): three box filters, edges repeated."""
    radius = max(round((np.sqrt(4 * sigma * sigma + 1) - 1) / 2), 0)
    result = np.asarray(values, np.float64)
    for _ in range(3):
        result = uniform_filter(result, 2 * radius + 1, mode="nearest")
    return result
