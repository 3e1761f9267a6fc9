"""Darts thrown at a surface, as many to each part as it has room for. Kernel: darts.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.lattice import Lattice, spatial_order
from rhytid.synthesis.rooms import rooms, spacings
from rhytid.synthesis.surface import FloatArray, Surface
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Throw:
    """N darts on the device; they are overwritten by the next throw.

    triangle (N,) int32, -1 for a dart outside the UDIMs or on bare skin.  place (N, 3) int32 on the
    lattice.  normal (N, 3) float32, not of unit length.  uv (N, 2) float32.  factor (N,) float32:
    of the spacing there.  priority (N,) uint32.
    """

    count: int
    triangle: Buffer
    place: Buffer
    normal: Buffer
    uv: Buffer
    factor: Buffer
    priority: Buffer


class Darts:
    """Throws at most `most` darts at a time.

    room: the area of the surface in units of squared spacing factors, those of the densest place of
    each triangle; 1 where spacing is even.  filled: the same by the mean of each triangle, which is
    what pores have.
    """

    def __init__(
        self, work: Workspace, surface: Surface, fields: Fields, seed: int, most: int
    ) -> None:
        carriers = np.flatnonzero(surface.carries)
        self.lattice = Lattice.around(surface.corners[carriers].reshape(-1, 3))
        centres = surface.corners[carriers].mean(axis=1)
        carriers = carriers[spatial_order(self.lattice.places(centres))]
        weights, filled = rooms(surface, fields, carriers)
        self.room, self.filled = float(weights.sum()), float(filled.sum())
        self._work, self._fields, self._seed = work, fields, np.uint32(seed)
        self._even = fields.least_spacing == fields.most_spacing == 1.0
        places = self.lattice.places(surface.corners[carriers])
        places[:, 1:] -= places[:, :1]
        normals = surface.normals[carriers].astype(np.float32)
        self._tables = (
            len(carriers),
            work.upload(_ends(weights)),
            work.upload(carriers.astype(np.int32)),
            work.upload(places),
            work.upload(normals),
            work.upload(map_corners(surface.uv)),
        )
        made = {"triangle": (1, np.int32), "place": (3, np.int32), "normal": (3, np.float32)}
        made |= {"uv": (2, np.float32), "priority": (1, np.uint32)}
        self._made = {name: work.empty(most * n, kind) for name, (n, kind) in made.items()}
        self._factor, self._where = work.full(most, np.float32(1.0)), work.empty(1, np.int32)

    def throw(self, start: int, count: int, total: int, turn: int) -> Throw:
        """Darts number start to start + count of `total`; another turn gives other darts."""
        made, work = self._made, self._work
        work.run(
            "darts", "throw_darts", count, np.uint32(start), np.uint32(total), np.uint32(turn),
            self._seed, *self._tables, made["triangle"], made["place"], made["normal"],
            made["uv"], made["priority"],
        )  # fmt: skip
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


def map_corners(uv: FloatArray) -> NDArray[np.float32]:
    """(F, 8) the origin of the UDIM where a triangle begins and its corners from there."""
    origin = np.floor(uv.min(axis=1, keepdims=True))
    local = (uv - origin).reshape(len(uv), 6)
    return np.concatenate([origin[:, 0], local], axis=1).astype(np.float32)


def _ends(weights: FloatArray) -> NDArray[np.uint32]:
    """(C,) where the stretch of each ends on [0, 2³²)."""
    share = np.cumsum(weights) / weights.sum()
    ends: NDArray[np.uint32] = np.minimum(np.rint(share * 2.0**32), 2.0**32 - 1).astype(np.uint32)
    return ends
