"""Pores: Poisson-disk sampling that is even on the surface, whatever its UV layout. Kernels:
darts.cl, pores.cl.

Darts are thrown, as many to each part of the surface as it has room for; of those that no older
pore is too close to, none too close to another are kept. Each triangle has darts of its own, by a
word from its place in the map: nothing beside the triangle decides which they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.dart_selection import DartSelection, Throw
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.hashes import Words, random4, triangle_keys
from rhytid.synthesis.lattice import Lattice, spatial_order
from rhytid.synthesis.pore_density import PACKING, densities, effective_area, spacings
from rhytid.synthesis.progress import Progress, over_rows, rows_where
from rhytid.synthesis.surface import FloatArray, Points, Surface
from rhytid.synthesis.workspace import Workspace

_PHASE = 0x9E3779B9
# Darts thrown per expected pore, in rounds. Where so many miss, another centre would have had a
# room of a few per cent of r².
DARTS = (2.0, 3.0, 4.0, 5.0, 6.0)
# Darts thrown at a time: as many as there will be pores, within these. Fewer would lie so far apart
# that none finds in the cache what another has read.
BATCH, MOST_AT_A_TIME = 1 << 20, 1 << 23
# Of a surface without pores at most so many are thrown first.
_FIRST = 1 << 16
# As many times more, at most, as pores leave one of so many to be more than looked at.
_FEWER = 8
# Darts that a work-item looks at, as in darts.cl.
_TOGETHER = 8
# Numbers of each dart of a throw by name, and their kind.
_OF_DARTS: dict[str, tuple[int, DTypeLike]] = {
    "triangle": (1, np.int32), "place": (3, np.int32), "normal": (3, np.float32),
    "uv": (2, np.float32), "priority": (1, np.uint32), "level": (1, np.float32),
}  # fmt: skip


def scatter_pores(
    work: Workspace,
    surface: Surface,
    radius: float,
    seed: int,
    progress: Progress,
    fields: Fields | None = None,
) -> Points:
    """The pores of `scatter_around` where none are given."""
    return scatter_around(work, surface, radius, seed, progress, fields or Fields(), None)[0]


def scatter_around(
    work: Workspace,
    surface: Surface,
    radius: float,
    seed: int,
    progress: Progress,
    fields: Fields,
    first: Points | None,
) -> tuple[Points, NDArray[np.int32]]:
    """Scatter pores at least `radius` apart, so dense that hardly any more would fit. Returns them,
    and (L,) which of them are the `first`, pores that are there whatever their distance.

    radius: in units of the surface; where `fields` has spacing factors, times the mean of those of
    the two pores. Distances are Euclidean; sheets that touch face to face (lips, eyelids) are told
    apart by their normals.

    Darts are thrown many at a time: of a batch, those that no older pore is too close to are kept
    in the order of their priorities, as if they were thrown one by one. Which darts are kept
    depends on the place of each triangle in the map, its area and what is painted nearby, not on
    the size of a batch. Pores come in spatial order.
    """
    with work.nested() as nested:
        a_room = PACKING / radius**2
        most = int(np.clip(a_room * surface.area.sum(), BATCH, MOST_AT_A_TIME))
        darts = Darts(nested, surface, fields, radius, seed, most)
        selection = DartSelection(nested, darts.lattice, radius, fields, a_room * darts.filled)
        if first is not None and len(first):
            selection.start_with(first, spacings(fields, first.triangle, first.uv))
        every = max(sum(DARTS) * a_room * darts.room, 1.0)
        done = 0
        for turn, share in enumerate(DARTS):
            for thrown in darts.throws(turn, share * a_room, selection):
                progress(min(done / every, 1.0), "pores")
                selection.take(thrown)
                done += thrown.of
        points, order = selection.points()
    at = np.flatnonzero(order < (0 if first is None else len(first)))
    place = np.empty(len(at), np.int32)
    place[order[at]] = at
    return points, place


def packed_radius(surface: Surface, fields: Fields, pores: float) -> float:
    """The radius, in units of the surface, at which about so many pores fit on it."""
    return float(np.sqrt(PACKING * effective_area(surface, fields) / pores))


class Darts:
    """Throws at most `most` darts at a time, to fill a surface with pores `radius` apart.

    room: the area of even skin that takes as many darts as are thrown: each triangle counts by its
    densest place.  filled: the area of even skin that holds as many pores as fit: each triangle
    counts by its mean.
    """

    def __init__(
        self, work: Workspace, surface: Surface, fields: Fields, radius: float, seed: int, most: int
    ) -> None:
        self.lattice = Lattice.absolute(radius, *surface.extent)
        carriers = np.flatnonzero(surface.carries)
        centres = surface.corners[carriers].mean(axis=1)
        carriers = carriers[spatial_order(self.lattice.places(centres))]
        area = surface.area[carriers]
        self._most, mean = densities(surface, fields, carriers, radius)
        self.room, self.filled = float((area * self._most).sum()), float((area * mean).sum())
        self._area, self._key = area.astype(np.float32), triangle_keys(surface.uv[carriers])
        self._work, self._fields, self._seed = work, fields, np.uint32(seed)
        self._even = fields.least_spacing == fields.most_spacing == 1.0
        self._least = work.upload(fields.closest(carriers))
        self._limit, self._one_of = most, 1
        places = self.lattice.places(surface.corners[carriers])
        places[:, 1:] -= places[:, :1]
        normals = surface.normals[carriers].astype(np.float32)
        self._tables = tuple(
            work.upload(table)
            for table in (
                self._key, self._area, carriers.astype(np.int32), places, normals,
                map_corners(surface.uv),
            )
        )  # fmt: skip
        self._made: dict[str, Buffer] = {}

    def throws(self, turn: int, rate: float, among: DartSelection) -> Iterator[Throw]:
        """Throw `rate` darts per area of even skin, in as many throws as needed, those of lower
        priority first. Another `turn` gives other darts.

        among: the pores so far; darts that are surely too close to them are left out.
        """
        expected = np.float32(rate) * self._area
        counts = np.ceil(expected * self._most).astype(np.int64)
        phase = random4(self._key, turn, self._seed, _PHASE)[0]
        phases = self._work.upload(phase)
        for part, parts in self._ranges(counts, phase, turn):
            first, amounts = shared_out(counts, phase, part, parts)
            ends, starts = (
                self._work.upload(numbers)
                for numbers in (np.cumsum(amounts).astype(np.int32), first)
            )
            each = (
                np.uint32(turn), self._seed, np.uint32(parts), float(rate), len(amounts), ends,
                starts, *self._tables,
            )  # fmt: skip
            yield self._thrown(int(amounts.sum()), each, phases, among)
            self._work.release(ends, starts)
        self._work.release(phases)

    def _ranges(self, counts: NDArray[np.int64], phase: Words, turn: int) -> list[tuple[int, int]]:
        """Parts of all darts that are thrown one after the other, and of how many parts each is
        one. None has more than can be thrown at a time. In the first turn each has as many as those
        before it together: the pores that these leave keep most of the others from being looked
        at."""
        limit = self._limit * min(self._one_of, _FEWER)
        found, left = [], [(0, 1)]
        while left:
            part, parts = left.pop()
            size = shared_out(counts, phase, part, parts)[1].sum()
            if size > limit or (turn == 0 and part == 0 and size > _FIRST):
                left += [(2 * part + 1, 2 * parts), (2 * part, 2 * parts)]
            else:
                found.append((part, parts))
        return found

    def _thrown(
        self, every: int, each: tuple[Any, ...], phases: Buffer, among: DartSelection
    ) -> Throw:
        """Darts of a throw of `every`.  each: arguments of kernels that say where one is."""
        chosen = self._sifted(every, each, among)
        work, count = self._work, len(chosen)
        self._one_of = every // max(count, 1)
        work.release(*self._made.values())
        self._made = made = {
            name: work.readable(count * n, kind) for name, (n, kind) in _OF_DARTS.items()
        }
        listed = work.lend(chosen)
        work.run(
            "darts", "throw_darts", count, *each, phases, listed, made["triangle"],
            made["place"], made["normal"], made["uv"], made["priority"], made["level"],
        )  # fmt: skip
        work.release(listed)
        if self._even and not self._fields.some_bare:
            made["factor"] = work.full(count, np.float32(1.0))
        else:
            factor, where = self._looked_up(count)
            work.release(made["triangle"])
            made["factor"], made["triangle"] = work.lend(factor), work.lend(where)
        return Throw(count, every, **made)

    def _sifted(self, every: int, each: tuple[Any, ...], among: DartSelection) -> NDArray[np.int32]:
        """The darts of a throw that may have room among pores. Most have none whatever the spacing
        is where they lie, which takes longer to look up."""
        found = self._work.readable(every, np.uint8)
        self._work.run(
            "darts", "sift_darts", -(-every // _TOGETHER), every, *each, self._least, *among.lists,
            found,
        )  # fmt: skip
        may = self._work.read(found, (every,), np.bool_)
        self._work.release(found)
        return rows_where(every, lambda rows: may[rows])

    def _looked_up(self, count: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Factors of darts, and their triangles, -1 for those on bare skin."""
        triangle = self._work.read(self._made["triangle"], (count,), np.int32)
        uv = self._work.read(self._made["uv"], (count, 2), np.float32)
        factor = np.empty(count, np.float32)

        def look_up(rows: slice) -> None:
            known = np.maximum(triangle[rows], 0)
            factor[rows] = spacings(self._fields, known, uv[rows])
            if self._fields.some_bare:
                triangle[rows][self._fields.bare(known, uv[rows])] = -1

        over_rows(count, look_up)
        return factor, triangle


def shared_out(
    counts: NDArray[np.int64], phase: Words, part: int, parts: int
) -> tuple[Words, NDArray[np.int64]]:
    """(C,) the first dart of each triangle that is thrown in a part, and (C,) how many are.

    parts: a power of two; the priority of dart n is n + phase with its bits in reverse order, so
    that parts are ranges of it, in their order.
    """
    width = parts.bit_length() - 1
    turned = int(f"{part:0{width}b}"[::-1], 2) if width else 0
    first = (np.uint32(turned) - phase) & np.uint32(parts - 1)
    return first, np.maximum(counts - first + (parts - 1), 0) // parts


def map_corners(uv: FloatArray) -> NDArray[np.float32]:
    """(F, 8) of each triangle the origin of the UDIM that it begins in, and its corners from
    there."""
    origin = np.floor(uv.min(axis=1, keepdims=True))
    local = (uv - origin).reshape(len(uv), 6)
    return np.concatenate([origin[:, 0], local], axis=1).astype(np.float32)
