"""What of many darts thrown at once is kept: none too close to another. Kernels: pores.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.edges.rounds import KEPT, until_decided
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.grid import Grid
from rhytid.synthesis.pores.darts import Darts, Throw
from rhytid.synthesis.pores.lattice import spatial_order
from rhytid.synthesis.surface import Points, unit
from rhytid.synthesis.workspace import Workspace

# A pore this much beyond the radius is still too close: what the device rounds.
_ROUNDING = 1.0 + 1e-6
_SPARE = 1024


@dataclass(frozen=True, eq=False)
class _Kept:
    """Room on the device for so many pores: as Throw, without priorities."""

    most: int
    triangle: Buffer
    place: Buffer
    normal: Buffer
    uv: Buffer
    factor: Buffer

    @classmethod
    def empty(cls, work: Workspace, most: int) -> _Kept:
        triangle, factor = work.empty(most, np.int32), work.empty(most, np.float32)
        place, normal = work.empty(3 * most, np.int32), work.empty(3 * most, np.float32)
        return cls(most, triangle, place, normal, work.empty(2 * most, np.float32), factor)

    @property
    def arrays(self) -> tuple[Buffer, ...]:
        return self.triangle, self.place, self.normal, self.uv, self.factor


class DartSelection:
    """The pores so far, and what a batch of darts adds to them.

    expected: how many pores there will be, about; there is room for more.
    """

    def __init__(
        self, work: Workspace, darts: Darts, radius: float, fields: Fields, expected: float
    ) -> None:
        self.count = 0
        self._work, self._lattice = work, darts.lattice
        reach = radius * _ROUNDING
        self._cell = self._lattice.steps(reach * fields.most_spacing)
        self._scale = float(self._lattice.unit / reach)
        self._kept, self._grid = self._empty(int(1.1 * expected) + _SPARE)

    def take(self, darts: Throw) -> None:
        """Keep what fits of a throw."""
        room = self._work.empty(darts.count, np.uint8)
        self._work.run(
            "pores", "find_room", darts.count, darts.triangle, darts.place, darts.normal,
            darts.factor, darts.level, self._kept.place, self._kept.normal, self._kept.factor,
            *self._grid.arguments, self._scale, room,
        )  # fmt: skip
        fitting = np.flatnonzero(self._work.read(room, (darts.count,), np.uint8))
        self._work.release(room)
        if len(fitting):
            self._add(darts, self._thinned(darts, fitting.astype(np.int32)))

    def points(self) -> Points:
        """The pores, neighbours near each other."""
        read, count = self._work.read, self.count
        place = read(self._kept.place, (count, 3), np.int32)
        order = spatial_order(place)
        triangle = read(self._kept.triangle, (count,), np.int32)[order]
        uv = read(self._kept.uv, (count, 2), np.float32)[order]
        normal = read(self._kept.normal, (count, 3), np.float32)[order]
        return Points(triangle, uv, self._lattice.positions(place[order]), unit(normal))

    def _thinned(self, darts: Throw, fitting: NDArray[np.int32]) -> NDArray[np.int32]:
        """Those of the fitting darts that are kept when they come in the order of priority."""
        with self._work.room() as room:
            listed = room.upload(fitting)
            grid = Grid.empty(room, self._cell, len(fitting), darts.count)
            grid.insert_listed(room, darts.place, listed, len(fitting))
            arguments = (
                listed, darts.place, darts.normal, darts.factor, darts.priority, *grid.arguments,
                self._scale,
            )  # fmt: skip
            state = until_decided(
                room, "pores", "decide_darts", len(fitting), arguments, darts.count
            )
            kept = room.read(state, (darts.count,), np.uint8)[fitting] == KEPT
        chosen: NDArray[np.int32] = fitting[kept]
        return chosen

    def _add(self, darts: Throw, chosen: NDArray[np.int32]) -> None:
        if self.count + len(chosen) > self._kept.most:
            self._make_room(2 * (self.count + len(chosen)))
        listed = self._work.upload(chosen)
        self._work.run(
            "pores", "take_darts", len(chosen), self.count, listed, darts.triangle, darts.place,
            darts.normal, darts.uv, darts.factor, *self._kept.arrays,
        )  # fmt: skip
        self._grid.insert(self._work, self._kept.place, self.count, len(chosen))
        self._work.release(listed)
        self.count += len(chosen)

    def _empty(self, most: int) -> tuple[_Kept, Grid]:
        return _Kept.empty(self._work, most), Grid.empty(self._work, self._cell, most)

    def _make_room(self, most: int) -> None:
        """Move what there is to larger arrays: borders can make for more pores than areas do."""
        kept, grid = self._empty(most)
        everyone = self._work.upload(np.arange(self.count, dtype=np.int32))
        self._work.run(
            "pores", "take_darts", self.count, 0, everyone, *self._kept.arrays, *kept.arrays
        )
        grid.insert(self._work, kept.place, 0, self.count)
        self._work.release(everyone, *self._kept.arrays, self._grid.head, self._grid.next)
        self._kept, self._grid = kept, grid
