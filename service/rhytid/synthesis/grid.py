"""Points on the device, listed by cell of a cubic grid. Kernels: grid.cl, points.clh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Grid:
    """Lists of point numbers.  cell: side in steps of the lattice.  mask: of list numbers."""

    cell: int
    mask: np.uint32
    head: Buffer
    next: Buffer

    @classmethod
    def empty(cls, work: Workspace, cell: int, points: int, numbers: int | None = None) -> Grid:
        """Lists for about so many points, none in yet; their numbers are below `numbers`."""
        lists = 1 << max(points, 64).bit_length()
        head = work.full(lists, np.int32(-1))
        return cls(cell, np.uint32(lists - 1), head, work.empty(numbers or points, np.int32))

    @property
    def arguments(self) -> tuple[Any, ...]:
        """As kernels take it."""
        return self.cell, self.mask, self.head, self.next

    def insert(self, work: Workspace, place: Buffer, start: int, count: int) -> None:
        """Put in points start to start + count of their places."""
        work.run("grid", "insert_range", count, start, place, *self.arguments)

    def insert_listed(self, work: Workspace, place: Buffer, listed: Buffer, count: int) -> None:
        """Put in the first `count` points of a list of numbers."""
        work.run("grid", "insert_points", count, listed, place, *self.arguments)
