"""Which darts are kept as pores: those that no older pore is too close to, none too close to one
another. The pores kept so far stay on the device, with their lists by cell. Kernels: pores.cl."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.incidence import KEPT, starts_of, until_decided
from rhytid.synthesis.lattice import Grid, Lattice, mask_of_lists, spatial_order
from rhytid.synthesis.progress import gathered, over_rows, rows_where
from rhytid.synthesis.surface import Points, unit
from rhytid.synthesis.workspace import Workspace

# Starts of lists that a work-item adds up, as in pores.cl, and how many pores are read beyond the
# last.
_CHUNK, _BEYOND = 1024, 8
# A pore this much beyond the radius is still too close: what the device rounds.
_ROUNDING = 1.0 + 1e-6
_SPARE = 1024


@dataclass(frozen=True, eq=False)
class Throw:
    """N darts on the device, of so many that were thrown; the next throw overwrites them.

    triangle (N,) int32, -1 for a dart outside the UDIMs or on bare skin.  place (N, 3) int32 on the
    lattice.  normal (N, 3) float32, not of unit length.  uv (N, 2) float32.  factor (N,) float32:
    of the spacing there.  priority (N,) uint32.  level (N,) float32: a dart counts where this is
    below one over the squared factor.
    """

    count: int
    of: int
    triangle: Buffer
    place: Buffer
    normal: Buffer
    uv: Buffer
    factor: Buffer
    priority: Buffer
    level: Buffer


class DartSelection:
    """The pores that were kept so far; each batch of darts adds some.

    expected: about how many pores there will be; more fit.
    """

    def __init__(
        self, work: Workspace, lattice: Lattice, radius: float, fields: Fields, expected: float
    ) -> None:
        self.count = 0
        self._work, self._lattice = work, lattice
        reach = radius * _ROUNDING
        self._cell = self._lattice.steps(reach * fields.most_spacing)
        self._scale = float(self._lattice.unit / reach)
        self._kept = KeptPores.empty(work, int(1.1 * expected) + _SPARE)
        self._lists: PoreLists | None = None

    def start_with(self, pores: Points, factor: NDArray[np.float32]) -> None:
        """Keep pores before any dart.  factor (L,): of the spacing at each."""
        upload, count = self._work.upload, len(pores)
        arrays = (
            pores.triangle.astype(np.int32), self._lattice.places(pores.position),
            pores.normal.astype(np.float32), pores.uv.astype(np.float32), factor,
        )  # fmt: skip
        triangle, place, normal, uv, factors = (upload(array) for array in arrays)
        none = upload(np.zeros(count, np.uint32))
        throw = Throw(count, count, triangle, place, normal, uv, factors, none, none)
        self._add(throw, np.arange(count, dtype=np.int32))
        self._work.release(triangle, place, normal, uv, factors, none)

    @property
    def lists(self) -> tuple[Any, ...]:
        """The arguments of kernels that look for pores that are too close."""
        if self._lists is None:
            self._lists = PoreLists.of(self._work, self._kept, self.count)
        return self._cell, *self._lists.arguments, self._scale

    def take(self, darts: Throw) -> None:
        """Keep those darts of a throw that fit."""
        room = self._work.readable(darts.count, np.uint8)
        self._work.run(
            "pores", "find_room", darts.count, darts.triangle, darts.place, darts.normal,
            darts.factor, darts.level, *self.lists, room,
        )  # fmt: skip
        fits = self._work.read(room, (darts.count,), np.bool_)
        fitting = rows_where(darts.count, lambda rows: fits[rows])
        self._work.release(room)
        if len(fitting):
            self._add(darts, self._thinned(darts, fitting))

    def points(self) -> tuple[Points, NDArray[np.intp]]:
        """The pores in spatial order, and (N,) that order of those that were kept."""
        read, count = self._work.read, self.count
        found = read(self._kept.pores, (count, 8), np.int32)
        order = spatial_order(found[:, :3])
        position, normal = self._placed(found, order)
        del found
        triangle = gathered(read(self._kept.triangle, (count,), np.int32), order)
        uv = gathered(read(self._kept.uv, (count, 2), np.float32), order)
        return Points(triangle, uv, position, normal), order

    def _placed(
        self, found: NDArray[np.int32], order: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Positions (N, 3) and normals (N, 3) of kept pores (N, 8), in an order."""
        position, normal = np.empty((len(order), 3)), np.empty((len(order), 3), np.float32)

        def place(rows: slice) -> None:
            some = found[order[rows]]
            position[rows] = self._lattice.positions(some[:, :3])
            normal[rows] = unit(some[:, 4:7].view(np.float32))

        over_rows(len(order), place)
        return position, normal

    def _thinned(self, darts: Throw, fitting: NDArray[np.int32]) -> NDArray[np.int32]:
        """The fitting darts that are kept when they come in the order of priority."""
        with self._work.nested() as nested:
            listed = nested.lend(fitting)
            grid = Grid.empty(nested, self._cell, len(fitting), darts.count)
            grid.insert_listed(nested, darts.place, listed, len(fitting))
            arguments = (
                listed, darts.place, darts.normal, darts.factor, darts.priority, *grid.arguments,
                self._scale,
            )  # fmt: skip
            state = until_decided(
                nested, "pores", "decide_darts", len(fitting), arguments, darts.count
            )
            kept = nested.read(state, (darts.count,), np.uint8)[fitting] == KEPT
        chosen: NDArray[np.int32] = fitting[kept]
        return chosen

    def _add(self, darts: Throw, chosen: NDArray[np.int32]) -> None:
        if self.count + len(chosen) > self._kept.most:
            self._make_room(2 * (self.count + len(chosen)))
        listed = self._work.lend(chosen)
        self._work.run(
            "pores", "take_darts", len(chosen), self.count, listed, darts.triangle, darts.place,
            darts.normal, darts.uv, darts.factor, self._cell, *self._kept.arrays,
        )  # fmt: skip
        self._work.release(listed)
        self.count += len(chosen)
        if self._lists is not None:
            self._work.release(self._lists.starts, self._lists.numbers)
        self._lists = None

    def _make_room(self, most: int) -> None:
        """Move the pores to larger arrays: along borders more fit than the area suggests."""
        old, self._kept = self._kept, KeptPores.empty(self._work, most)
        self._work.run(
            "pores", "move_pores", self.count, old.pores, old.triangle, old.uv, self._cell,
            *self._kept.arrays,
        )  # fmt: skip
        self._work.release(old.pores, old.triangle, old.uv)


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
        pores, triangle = work.readable(8 * most, np.int32), work.readable(most, np.int32)
        uv = work.readable(2 * most, np.float32)
        return cls(most, mask_of_lists(most), pores, triangle, uv)

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
