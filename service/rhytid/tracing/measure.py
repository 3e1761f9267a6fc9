"""Measures of scans and of what was traced of them: the fine part of a relief, the depth that lines
are drawn with, and how much of a relief is left."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Relief = NDArray[np.float32]
Inside = NDArray[np.bool_]
# Texels of a side of the mean that the fine part is without.
BROAD = 33
# The same where lines with a broad layer are looked for. That layer is as broad as swells of skin,
# and hides faint lines beside deep ones; with 9 and 13 fewer of those of grown skin were found.
NARROW = 5
# The share of the texels of charts that lie less deep than a line of weight 1.
_DEEPEST = 0.999


def fine_part(relief: Relief, inside: Inside) -> Relief:
    """The relief (H, W) less its mean around each texel, over what is inside (H, W); 0 outside."""
    shares = mean_around(inside.astype(np.float32), BROAD, "constant")
    sums = mean_around(np.where(inside, relief, np.float32(0.0)), BROAD, "constant")
    broad = sums / np.maximum(shares, np.float32(1e-6))
    fine: Relief = np.where(inside, relief - broad, np.float32(0.0))
    return fine


def depth_of(fine: Relief, inside: Inside) -> float:
    """The depth of a line of weight 1, relief units: that of the deepest thousandth of the texels
    inside, in their fine part. Weights are 1 at most, and what is deeper stays in the residual. 0
    where there is no relief."""
    if not inside.any():
        return 0.0
    return max(float(np.quantile(-fine[inside], _DEEPEST)), 0.0)


def rms(values: Relief, inside: Inside) -> float:
    """The root mean square of values (H, W) inside; 0 where nothing is."""
    chosen = np.where(inside, values, np.float32(0.0))
    return rms_of_some(chosen, int(np.count_nonzero(inside)))


def rms_of_some(values: Relief, count: int) -> float:
    """The root mean square of `count` values of a map (H, W) whose others are 0; 0 where there are
    none."""
    rows = np.einsum("ij,ij->i", values, values).astype(np.float64)
    return float(np.sqrt(rows.sum() / count)) if count else 0.0


def mean_around(values: Relief, side: int, beyond: str = "nearest") -> Relief:
    """The mean around each texel, of a nearly Gaussian weight: that over `side` texels, twice.

    beyond: the border of the map, as SciPy has it.
    """
    once = scipy.ndimage.uniform_filter(values, side, mode=beyond)
    found: Relief = scipy.ndimage.uniform_filter(once, side, mode=beyond)
    return found


def taps_of_mean(side: int) -> NDArray[np.float32]:
    """(2 side - 1,) the weights of `mean_around` along a row."""
    once = np.full(side, 1.0 / side)
    return np.convolve(once, once).astype(np.float32)
