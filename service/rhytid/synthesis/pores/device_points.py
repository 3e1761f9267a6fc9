"""Pores on the device, for those who ask what lies near them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.synthesis.grid import Grid
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class DevicePoints:
    """N points: place (N, 3) int32 steps of the lattice, normal (N, 3) float32, in a grid."""

    count: int
    lattice: Lattice
    place: Buffer
    normal: Buffer
    grid: Grid

    @classmethod
    def of(
        cls, work: Workspace, points: Points, cell: float, lattice: Lattice | None = None
    ) -> DevicePoints:
        """Upload points, in cells of side `cell`; on a lattice around them if none is given."""
        lattice = lattice or Lattice.around(points.position)
        place = work.upload(lattice.places(points.position))
        normal = work.upload(points.normal.astype(np.float32))
        grid = Grid.empty(work, lattice.steps(cell), len(points))
        grid.insert(work, place, 0, len(points))
        return cls(len(points), lattice, place, normal, grid)

    @property
    def points(self) -> tuple[Any, ...]:
        """Places and normals as kernels take them."""
        return self.place, self.normal
