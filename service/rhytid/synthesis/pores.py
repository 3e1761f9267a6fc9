"""Pores: Poisson-disk sampling that is even on the surface, whatever its UV. Kernels: pores.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.synthesis.darts import Darts, Throw, total_room
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.grid import Grid
from rhytid.synthesis.lattice import Lattice, spatial_order
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.rounds import KEPT, until_decided
from rhytid.synthesis.surface import Points, Surface, unit
from rhytid.synthesis.workspace import Workspace

# Centres per r² once DARTS are thrown. (Thrown for ever, discs jam at 0.547 · 4/π = 0.696; the
# last of them fit into rooms too small to see.)
PACKING = 0.605
# Darts thrown per expected pore, in rounds. Where so many miss, another centre would have had a
# room of a few per cent of r².
DARTS = (2.0, 3.0, 4.0, 5.0, 6.0)
# Darts thrown at a time.
BATCH = 1 << 20
# A pore this much beyond the radius is still too close: what the device rounds.
_ROUNDING = 1.0 + 1e-6


def scatter_pores(
    work: Workspace,
    surface: Surface,
    radius: float,
    seed: int,
    progress: Progress,
    fields: Fields | None = None,
) -> Points:
    """Pores of one sheet at least `radius` apart, with next to no room for more.

    Times the mean of their spacing factors, where `fields` has such. Dart throwing, many at a time:
    those of a batch that no older pore is too close to are kept in the order of their priorities,
    as throwing them one by one would. Distances are Euclidean; surfaces that touch face to face
    (lips, eyelids) are kept apart by their normals. Pores come in spatial order.
    """
    fields = fields or Fields()
    with work.room() as room:
        darts = Darts(room, surface, fields, seed, BATCH)
        sieve = Sieve.of(room, darts, radius, fields.most_spacing)
        rounds = [int(np.ceil(share * sieve.expected)) for share in DARTS]
        done = 0
        for turn, total in enumerate(rounds):
            for start in range(0, total, BATCH):
                progress(done / sum(rounds), "pores")
                count = min(BATCH, total - start)
                sieve.take(darts.throw(start, count, total, turn))
                done += count
        return sieve.points()


def packed_radius(surface: Surface, fields: Fields, pores: float) -> float:
    """The radius at which about so many pores fit on the surface."""
    return float(np.sqrt(PACKING * total_room(surface, fields) / pores))


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


class Sieve:
    """The pores so far, and what a batch of darts adds to them.

    expected: how many pores there will be, about.
    """

    def __init__(
        self, work: Workspace, lattice: Lattice, reach: int, radius: float, expected: float
    ) -> None:
        self.expected = expected
        self.count = 0
        self._work, self._lattice, self._reach = work, lattice, reach
        self._scale = float(lattice.unit / (radius * _ROUNDING))
        self._kept, self._grid = self._empty(int(1.1 * expected) + BATCH // 64)

    @classmethod
    def of(cls, work: Workspace, darts: Darts, radius: float, most_spacing: float) -> Sieve:
        """For pores of a radius among darts."""
        reach = darts.lattice.steps(radius * most_spacing * _ROUNDING)
        expected = PACKING * darts.room / radius**2
        return cls(work, darts.lattice, reach, radius, expected)

    def take(self, darts: Throw) -> None:
        """Keep what fits of a throw."""
        room = self._work.empty(darts.count, np.uint8)
        self._work.run(
            "pores", "find_room", darts.count, darts.triangle, darts.place, darts.normal,
            darts.factor, self._kept.place, self._kept.normal, self._kept.factor,
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
            grid = Grid.empty(room, self._reach, len(fitting), darts.count)
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
        return _Kept.empty(self._work, most), Grid.empty(self._work, self._reach, most)

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
