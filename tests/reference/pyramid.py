"""Levels of a map: each texel the mean of 2x2 texels of the level below."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array


def halve(level: ArrayLike) -> Array:
    """The next level of a map (..., R, R), R even: (..., R/2, R/2)."""
    values = np.asarray(level, np.float64)
    *front, rows, columns = values.shape
    blocks = values.reshape(*front, rows // 2, 2, columns // 2, 2)
    mean: Array = blocks.mean(axis=(-3, -1))
    return mean


def levels(finest: ArrayLike) -> list[Array]:
    """All levels of a map (R, R), R a power of two, the map first and one texel last."""
    found = [np.asarray(finest, np.float64)]
    while found[-1].shape[-1] > 1:
        found.append(halve(found[-1]))
    return found
