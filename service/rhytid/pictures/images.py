"""Pictures as arrays, 8 bit RGB, (H, W, 3), row 0 at the top; and scales of colours.

A scale takes log stretch, an undirected axis or a signed height to sRGB in 0…1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Picture = NDArray[np.uint8]
BACKGROUND = (1.0, 1.0, 1.0)
NEUTRAL = (0.94, 0.94, 0.93)
_COMPRESSION = ((0.40, 0.02, 0.05), (0.80, 0.11, 0.13), (0.97, 0.62, 0.50))
_STRETCH = ((0.77, 0.66, 0.90), (0.48, 0.20, 0.70), (0.22, 0.02, 0.38))
_STOPS = np.array([*_COMPRESSION, NEUTRAL, *_STRETCH])


def to_picture(colour: NDArray[Any]) -> Picture:
    """A picture from sRGB values in 0…1, which are clipped; (H, W) becomes grey."""
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
        result = scipy.ndimage.uniform_filter(result, 2 * radius + 1, mode="nearest")
    return result


def diverging(log_stretch: ArrayLike, limit: float) -> NDArray[np.float64]:
    """(…, 3) colours: red for compression, purple for stretch, light grey at 0; the scale ends at
    ±limit (Fig. 3)."""
    t = np.clip(np.asarray(log_stretch, np.float64) / limit, -1, 1)
    places = np.linspace(-1, 1, len(_STOPS))
    return np.stack([np.interp(t, places, channel) for channel in _STOPS.T], axis=-1)


def axis_wheel(angle: ArrayLike, certainty: ArrayLike = 1.0) -> NDArray[np.float64]:
    """(…, 3) colours: the hue of an undirected axis with this angle, radians, the same after half a
    turn.

    certainty: 0…1, fades to the neutral grey where an axis means nothing (ρ₁ = ρ₂).
    """
    turn = 2 * np.asarray(angle, np.float64)[..., None]
    hue = 0.55 + 0.42 * np.cos(turn - np.array([0.0, 2 * np.pi / 3, 4 * np.pi / 3]))
    fade = np.clip(np.asarray(certainty, np.float64), 0, 1)[..., None]
    colour: NDArray[np.float64] = NEUTRAL + fade * (hue - NEUTRAL)
    return colour


def signed_grey(height: ArrayLike, limit: float) -> NDArray[np.float64]:
    """(…, 3) greys: mid grey at 0, black at -limit, white at +limit."""
    t = np.clip(np.asarray(height, np.float64) / limit, -1, 1)
    return np.repeat((0.5 + 0.5 * t)[..., None], 3, axis=-1)
