"""Darts thrown at a surface, as many to each part as it has room for. Kernel: darts.cl.

Each triangle has darts of its own, by a word from its place in the map: which they are hangs on
nothing beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.hashes import Words, random4, triangle_keys
from rhytid.synthesis.pores.area_capacity import densities, spacings
from rhytid.synthesis.pores.lattice import Lattice, spatial_order
from rhytid.synthesis.surface import FloatArray, Surface
from rhytid.synthesis.workspace import Workspace

_PHASE = 0x9E3779B9


@dataclass(frozen=True, eq=False)
class Throw:
    """N darts on the device; they are overwritten by the next throw.

    triangle (N,) int32, -1 for a dart outside the UDIMs or on bare skin.  place (N, 3) int32 on the
    lattice.  normal (N, 3) float32, not of unit length.  uv (N, 2) float32.  factor (N,) float32:
    of the spacing there.  priority (N,) uint32.  level (N,) float32: a dart counts where this is
    below one over the squared factor.
    """

    count: int
    triangle: Buffer
    place: Buffer
    normal: Buffer
    uv: Buffer
    factor: Buffer
    priority: Buffer
    level: Buffer


class Darts:
    """Throws at most `most` darts at a time, to fill a surface with pores `radius` apart.

    room: the area of the surface in units of squared spacing factors, those of the densest place of
    each triangle; the area where spacing is even.  filled: the same by the mean of each triangle,
    which is what pores have.
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
        self._limit = most
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
        made = {"triangle": (1, np.int32), "place": (3, np.int32), "normal": (3, np.float32)}
        made |= {"uv": (2, np.float32), "priority": (1, np.uint32), "level": (1, np.float32)}
        self._made = {name: work.empty(most * n, kind) for name, (n, kind) in made.items()}
        self._factor, self._where = work.full(most, np.float32(1.0)), work.empty(1, np.int32)

    def throws(self, turn: int, rate: float) -> Iterator[Throw]:
        """`rate` darts to an area where the factor of spacing is 1, in as many throws as it takes,
        those of lower priority first; another turn gives other darts."""
        expected = np.float32(rate) * self._area
        counts = np.ceil(expected * self._most).astype(np.int64)
        phase = random4(self._key, turn, self._seed, _PHASE)[0]
        parts = 1
        while max(shared_out(counts, phase, part, parts)[1].sum() for part in range(parts)) > (
            self._limit
        ):
            parts *= 2
        phases = self._work.upload(phase)
        for part in range(parts):
            first, amounts = shared_out(counts, phase, part, parts)
            yield self._throw(turn, rate, parts, first, amounts, phases)
        self._work.release(phases)

    def _throw(
        self,
        turn: int,
        rate: float,
        parts: int,
        first: Words,
        amounts: NDArray[np.int64],
        phases: Buffer,
    ) -> Throw:
        """Every `parts`-th dart of each triangle, so many from its `first` on."""
        made, work, count = self._made, self._work, int(amounts.sum())
        ends, starts = work.upload(np.cumsum(amounts).astype(np.int32)), work.upload(first)
        work.run(
            "darts", "throw_darts", count, np.uint32(turn), self._seed, np.uint32(parts),
            float(rate), len(amounts), ends, starts, phases, *self._tables, made["triangle"],
            made["place"], made["normal"], made["uv"], made["priority"], made["level"],
        )  # fmt: skip
        work.release(ends, starts)
        if self._even and not self._fields.some_bare:
            return Throw(count, factor=self._factor, **made)
        work.release(self._factor, self._where)
        factor, where = self._looked_up(count)
        self._factor, self._where = work.upload(factor), work.upload(where)
        return Throw(count, factor=self._factor, **{**made, "triangle": self._where})

    def _looked_up(self, count: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Factors of darts, and their triangles, -1 for those on bare skin."""
        triangle = self._work.read(self._made["triangle"], (count,), np.int32)
        uv = self._work.read(self._made["uv"], (count, 2), np.float32)
        known = np.maximum(triangle, 0)
        triangle = np.where(self._fields.bare(known, uv), np.int32(-1), triangle)
        return spacings(self._fields, known, uv), triangle


def shared_out(
    counts: NDArray[np.int64], phase: Words, part: int, parts: int
) -> tuple[Words, NDArray[np.int64]]:
    """(C,) the first number of the darts of each triangle, and how many, that are thrown in a part.

    parts: a power of two; the priority of dart n is n + phase with its bits in reverse order, so
    that parts are ranges of it, in their order.
    """
    width = parts.bit_length() - 1
    turned = int(f"{part:0{width}b}"[::-1], 2) if width else 0
    first = (np.uint32(turned) - phase) & np.uint32(parts - 1)
    return first, np.maximum(counts - first + (parts - 1), 0) // parts


def map_corners(uv: FloatArray) -> NDArray[np.float32]:
    """(F, 8) the origin of the UDIM where a triangle begins and its corners from there."""
    origin = np.floor(uv.min(axis=1, keepdims=True))
    local = (uv - origin).reshape(len(uv), 6)
    return np.concatenate([origin[:, 0], local], axis=1).astype(np.float32)
