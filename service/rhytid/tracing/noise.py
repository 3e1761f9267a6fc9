"""How much noise a map has from texel to texel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Texels of a side of a block, and the share of the blocks that are quieter: lines are fewer there.
_BLOCK, _QUIETER = 16, 0.2
# The median of the magnitudes of a normal distribution.
_MEDIAN = 0.6745


def noise_of(relief: NDArray[np.float32], inside: NDArray[np.bool_]) -> float:
    """The standard deviation of noise that is independent from texel to texel, relief units: that
    of the diagonal difference of each two by two texels (Donoho and Johnstone 1994), of the
    quietest blocks, for lines count there as noise does. 0 where no block is full.

    relief (H, W).  inside (H, W): where there is skin.
    """
    height, width = (side // _BLOCK * _BLOCK for side in relief.shape)
    r = relief[:height, :width].astype(np.float64)
    whole = inside[:height, :width]
    a, b, c, d = (r[y::2, x::2] for y in (0, 1) for x in (0, 1))
    half = _BLOCK // 2
    blocks = _in_blocks(0.5 * np.abs(a - b - c + d), half)
    full = _in_blocks(whole, _BLOCK).all(axis=1)
    if not full.any():
        return 0.0
    return float(np.quantile(np.median(blocks[full], axis=1), _QUIETER) / _MEDIAN)


def _in_blocks(values: NDArray[Any], side: int) -> NDArray[Any]:
    """(B, side²) the values of each block of a map."""
    rows, columns = (size // side for size in values.shape)
    cut = values.reshape(rows, side, columns, side).swapaxes(1, 2)
    found: NDArray[Any] = cut.reshape(rows * columns, side * side)
    return found
