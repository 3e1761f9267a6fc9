"""Cutting polygons into triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fan(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(F, 3) places in a flat list of corners: every polygon cut as a fan from its first corner.

    `counts` (P,) holds the corners of each polygon, at least 3.
    """
    triangles = counts - 2
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)
