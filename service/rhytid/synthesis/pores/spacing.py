"""How far pores stand apart. Kernel: nearest.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.edges.edges import DEFINES
from rhytid.synthesis.pores.device_points import DevicePoints
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace

# The first look goes so far, in spacings that the points would have on a flat square of area 1;
# those that find nothing look on twice as far.
_FIRST = 2.0


def mean_spacing(work: Workspace, pores: Points) -> tuple[float, float]:
    """Mean and deviation of the distance to the nearest pore of a sheet; 0 where none has one."""
    distance = nearest_distances(work, pores)
    found = distance[np.isfinite(distance)].astype(np.float64)
    return (float(found.mean()), float(found.std())) if len(found) else (0.0, 0.0)


def nearest_distances(work: Workspace, pores: Points) -> NDArray[np.float32]:
    """(N,) distance of each pore to the nearest of its sheet; infinity where there is none."""
    distance = np.full(len(pores), np.inf, np.float32)
    if len(pores) < 2:
        return distance
    extent = float(np.ptp(pores.position, axis=0).max())
    cell = min(_FIRST / np.sqrt(len(pores)), extent)
    left = np.arange(len(pores), dtype=np.int32)
    while len(left):
        with work.room() as room:
            distance[left] = _within(room, pores, left, cell)
        left = left[np.isinf(distance[left])] if cell < extent else left[:0]
        cell = min(2.0 * cell, extent)
    return distance


def _within(
    work: Workspace, pores: Points, asked: NDArray[np.int32], cell: float
) -> NDArray[np.float32]:
    """(K,) distances of those asked to their nearest within a cell, infinity else."""
    cloud = DevicePoints.of(work, pores, cell)
    nearest2 = work.empty(len(asked), np.float32)
    work.run(
        "nearest", "nearest_distance", len(asked), work.upload(asked), *cloud.points,
        *cloud.grid.arguments, float(cloud.lattice.unit / cell), nearest2, defines=DEFINES,
    )  # fmt: skip
    found = work.read(nearest2, (len(asked),), np.float32)
    distances: NDArray[np.float32] = np.float32(cell) * np.sqrt(found)
    return distances
