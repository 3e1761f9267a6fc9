"""Metrics of supports in UV: as a graph has them, and as they are in another chart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import LEAST_SIZE
from rhytid.domain.mesh import UV_LIMIT
from rhytid.synthesis.surface import BoolArray, FloatArray

# A support that is longer against its width is not copied: float32 cannot hold its metric.
_LONGEST = 500.0


def roots(metric: FloatArray) -> FloatArray:
    """(N, 2, 2) with rootᵀ·root = metric."""
    root: FloatArray = np.linalg.cholesky(metric).transpose(0, 2, 1)
    return root


def turned(metric: FloatArray, turn: FloatArray) -> FloatArray:
    """(T, 2, 2) metrics (T, 2, 2) as they are in the UV that `turn` (T, 2, 2) leads to."""
    back = np.linalg.inv(turn)
    there: FloatArray = back.transpose(0, 2, 1) @ metric @ back
    return there


def holds(metric: FloatArray, uv: FloatArray) -> BoolArray:
    """(T,) whether a graph can hold a support at a place."""
    sizes = np.linalg.eigvalsh(metric)
    slim = sizes[:, 1] <= _LONGEST**2 * sizes[:, 0]
    sized = (sizes[:, 0] > 1.001) & (sizes[:, 1] * LEAST_SIZE**2 < 0.5)
    held: BoolArray = slim & sized & (np.abs(uv) < UV_LIMIT).all(axis=1)
    return held


def full(metric: NDArray[np.float32]) -> FloatArray:
    """(N, 2, 2) metrics (N, 3) of a graph."""
    whole: FloatArray = metric.astype(np.float64)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return whole


def flat(metric: FloatArray) -> NDArray[np.float32]:
    """(N, 3) as a graph has them of metrics (N, 2, 2)."""
    three: NDArray[np.float32] = metric.reshape(-1, 4)[:, [0, 1, 3]].astype(np.float32)
    return three
