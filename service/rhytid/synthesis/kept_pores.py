"""Pores that were kept so far, on the device, and their lists by cell. Kernels: pores.cl."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.synthesis.incidence import starts_of
from rhytid.synthesis.lattice import mask_of_lists
from rhytid.synthesis.workspace import Workspace

# Starts of lists that a work-item adds up, as in pores.cl, and how many pores are read beyond the
# last.
_CHUNK, _BEYOND = 1024, 8


@dataclass(frozen=True, eq=False)
class KeptPores:
    """Arrays on the device for up to `most` pores.

    mask: of the numbers of lists.  pores (most, 8) int32: place, factor and normal of each, and the
    number of its list.
    """

    most: int
    mask: np.uint32
    pores: Buffer
    triangle: Buffer
    uv: Buffer

    @classmethod
    def empty(cls, work: Workspace, most: int) -> KeptPores:
        """Arrays without pores."""
        pores, triangle = work.empty(8 * most, np.int32), work.empty(most, np.int32)
        return cls(most, mask_of_lists(most), pores, triangle, work.empty(2 * most, np.float32))

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The arguments of kernels that add pores."""
        return self.mask, self.pores, self.triangle, self.uv


@dataclass(frozen=True, eq=False)
class PoreLists:
    """Pores in the order of their lists, one list for each cell, as darts look for them.

    starts: where each list begins.  numbers (7, room): of the pores by themselves, so that eight
    are looked at together.
    """

    mask: np.uint32
    starts: Buffer
    numbers: Buffer
    room: int

    @classmethod
    def of(cls, work: Workspace, kept: KeptPores, count: int) -> PoreLists:
        """The lists of the first `count` pores."""
        chunks = -(-(int(kept.mask) + 3) // _CHUNK)
        starts, sums = work.full(chunks * _CHUNK, np.int32(0)), work.empty(chunks, np.int32)
        work.run("pores", "count_pores", count, kept.pores, starts)
        work.run("pores", "sum_chunks", chunks, starts, sums)
        before = work.upload(starts_of(work.read(sums, (chunks,), np.int32)))
        work.run("pores", "add_up_chunks", chunks, before, starts)
        order, room = work.empty(count, np.int32), count + _BEYOND
        numbers = work.empty(7 * room, np.int32)
        work.run("pores", "order_pores", count, kept.pores, starts, order)
        work.run("pores", "list_pores", room, kept.pores, order, numbers)
        work.release(sums, before, order)
        return cls(kept.mask, starts, numbers, room)

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of kernels that look for pores."""
        return self.mask, self.starts, self.numbers, self.room
