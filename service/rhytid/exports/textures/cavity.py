"""Cavity maps: how far skin lies below its surroundings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.exports.textures.frame_map import Chart, Facts, FrameMap
from rhytid.exports.textures.square_sums import Sums, with_square_sums
from rhytid.exports.textures.writers import write_png

_WHITE = 255


def cavity_facts(map: FrameMap) -> Facts:
    """Facts of cavity: a texel lies (1 - value) times `scale` below its surroundings."""
    return {"scale": map.depth, "midlevel": 1.0}


def write_cavity(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write a grey PNG of 8 bits: white is as high as its surroundings or higher, black lower by
    the depth of a furrow of strength 1, or more."""
    codes, least = cavity_codes(map.heights(), map.chart(), map.depth)
    # The highest texel of all is no lower than those around it.
    return write_png(path, codes, map, facts, (least, 1.0))


def cavity_codes(
    heights: NDArray[np.float32], chart: Chart, depth: float
) -> tuple[NDArray[np.uint8], float]:
    """(R, R) codes, 255 for texels no lower than the mean around them, to 0, lower by `depth` or
    more; and the least value before rounding, 0 to 1.

    heights, depth: mesh units. Texels outside of the islands do not count in the mean. In the
    padding a texel has the value of the nearest texel inside, beyond it 1.
    """
    inside, counts = chart.inside, chart.inside_around
    codes, lows = np.empty(heights.shape, np.uint8), list[float]()

    def found(sums: Sums) -> None:
        first, total = sums
        rows = slice(first, first + len(total))
        total /= counts[rows]
        np.subtract(heights[rows], total, out=total)
        total /= depth
        np.clip(total, -1.0, 0.0, out=total)
        total += 1.0
        lows.append(float(np.where(inside[rows], total, 1.0).min()))
        total *= _WHITE
        codes[rows] = np.rint(total, out=total)

    with_square_sums(lambda rows: heights[rows] * inside[rows], len(heights), chart.around, found)
    padded = chart.padded(codes)
    padded[~chart.covered] = _WHITE
    return padded, min(lows)
