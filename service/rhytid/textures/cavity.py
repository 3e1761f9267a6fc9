"""Cavity maps: how far a place lies below what is around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

# The square around a texel, as a share of the side of a map: some 4 mm on a face that fills it.
AROUND = 1.0 / 64.0


def cavity_map(
    heights: NDArray[np.float32], covered: NDArray[np.bool_], depth: float
) -> NDArray[np.float32]:
    """(R, R) from 1, no lower than the mean around it, to 0, `depth` lower or more; 1 where no
    triangle is. heights, depth: mesh units; covered: which texels show a triangle, and count in
    the mean."""
    size = max(round(AROUND * len(heights)), 1) | 1
    shown = covered.astype(np.float32)
    share = ndimage.uniform_filter(shown, size, mode="constant")
    mean = ndimage.uniform_filter(heights * shown, size, mode="constant")
    mean /= np.maximum(share, np.float32(0.5 / size**2))
    below = (heights - mean) / np.float32(depth)
    found: NDArray[np.float32] = np.where(covered, 1.0 + below.clip(-1.0, 0.0), 1.0)
    return found.astype(np.float32)
