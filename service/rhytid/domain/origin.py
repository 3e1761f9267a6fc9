"""Positions far from the origin: how coarse float32 is there, and the centre that is subtracted.

Stretch does not depend on where a face stands. Doubles are moved to the origin before they are
rounded; what was rounded before stays rounded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A mesh this many times its own size away from the origin is brought there: it has lost 4 of the
# 24 bits of a float32, and keeps 20. Nearer ones stay as they are, bit for bit.
FAR_SIZES = 16.0
# Mean distance of numbers from the nearest float32, in steps: 0.25 where they are doubles, 0 where
# they were float32 once. Decimal text of float32 comes within a few hundredths.
_ROUNDED = 0.05

Centre = NDArray[np.float64]
ORIGIN: Centre = np.zeros(3)
ORIGIN.setflags(write=False)


def centre_for(positions: NDArray[np.floating]) -> Centre:
    """(3,) what to subtract from positions (V, 3) before they become float32: the middle of their
    box, rounded to a power of two; 0 where they are near, or are float32 already."""
    values = np.asarray(positions)
    if not len(values) or not np.isfinite(values).all() or values.dtype.itemsize <= 4:
        return ORIGIN
    low, high = values.min(axis=0).astype(np.float64), values.max(axis=0).astype(np.float64)
    size = float((high - low).max())
    farthest = float(np.maximum(np.abs(low), np.abs(high)).max())
    if not 0.0 < FAR_SIZES * size < farthest < np.finfo(np.float32).max:
        return ORIGIN
    if was_float32(values):
        return ORIGIN
    # A multiple of a power of two: subtracting it from a float32 is exact.
    step = 2.0 ** np.floor(np.log2(size))
    centre: Centre = np.round((low + high) / 2.0 / step) * step
    return centre


def was_float32(values: NDArray[np.floating]) -> bool:
    """Whether doubles are, but for their last digits, float32."""
    near = values.astype(np.float32)
    gaps = np.abs(values - near.astype(np.float64)) / np.spacing(np.abs(near)).astype(np.float64)
    return bool(gaps.mean() < _ROUNDED)


def brought_to(values: NDArray[np.floating], centre: Centre) -> NDArray[np.floating]:
    """Positions (…, 3) less a centre, in double; themselves where it is the origin."""
    return values.astype(np.float64) - centre if centre.any() else values


def put_back(positions: NDArray[np.floating], centre: Centre) -> NDArray[np.floating]:
    """The inverse of `brought_to`: double where there is a centre."""
    return positions.astype(np.float64) + centre if centre.any() else positions


def number_step(positions: NDArray[np.float32], centre: Centre) -> float:
    """The step of the numbers that positions (V, 3) were sent as, less a centre by now.

    That of float32 at the farthest coordinate; with a centre, where they are no float32, what is
    left of it once the centre is gone.
    """
    if centre.any():
        sent = positions + centre
        if was_float32(sent):
            return float(np.spacing(np.float32(np.abs(sent).max(initial=0.0))))
    farthest = max(float(positions.max(initial=0.0)), -float(positions.min(initial=0.0)))
    return float(np.spacing(np.float32(farthest)))
