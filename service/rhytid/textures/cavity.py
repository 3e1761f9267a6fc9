"""Cavity maps: how far a texel lies below its surroundings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rhytid.textures.chart import Chart

# The square around a texel, as a share of the side of a map: some 4 mm on a face that fills it.
AROUND = 1.0 / 64.0


def cavity_map(heights: NDArray[np.float32], chart: Chart, depth: float) -> NDArray[np.float32]:
    """(R, R) from 1, no lower than the mean around it, to 0, `depth` lower or more. heights, depth:
    mesh units; texels outside of the islands do not count in the mean. In the padding it is as at
    the nearest texel inside, beyond it 1."""
    size = max(round(AROUND * len(heights)), 1) | 1
    shown = chart.inside.astype(np.float32)
    share = ndimage.uniform_filter(shown, size, mode="constant")
    mean = ndimage.uniform_filter(heights * shown, size, mode="constant")
    mean /= np.maximum(share, np.float32(0.5 / size**2))
    below = (heights - mean) / np.float32(depth)
    cavity = chart.padded(1.0 + below.clip(-1.0, 0.0))
    return np.where(chart.covered, cavity, np.float32(1.0)).astype(np.float32)
