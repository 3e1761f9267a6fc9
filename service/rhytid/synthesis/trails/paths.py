"""The candidate wrinkles as walkers see them: the ways out of each pore. Kernel: trails.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.edges.edges import DEFINES, Edges
from rhytid.synthesis.edges.incidence import Incidence
from rhytid.synthesis.hashes import place_keys
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Paths:
    """Ways out of N pores along E edges, on the device.

    ways: lists of edges by pore.  direction (2E, 2) int16: cosine and sine of each way out against
    the preferred direction of the pore, times 32767.  length (E,) float32.
    typical: length of edges on even skin.  anisotropy (N,) float32: how far walkers keep to those
    directions.  place (N, 3) int32: of the pores, in steps of `unit`.  key (N,) uint32: a word of
    each pore from its place in the map.
    """

    pores: int
    edges: int
    ways: Incidence
    direction: Buffer
    length: Buffer
    typical: float
    anisotropy: Buffer
    place: Buffer
    unit: float
    key: Buffer

    @classmethod
    def of(
        cls,
        work: Workspace,
        pores: Points,
        edges: Edges,
        along: NDArray[np.float32],
        left: NDArray[np.float32],
        anisotropy: NDArray[np.float32],
        lattice: Lattice,
        length: float,
    ) -> Paths:
        """Lay out the edges; `along`, `left` (N, 3) is the frame of each pore.

        lattice: of the places of pores.  length: of edges on even skin, typically.
        """
        ways = Incidence.of(work, work.upload(edges.nodes), len(edges), len(pores))
        place = work.upload(lattice.places(pores.position))
        frame = work.upload(along), work.upload(left)
        direction = work.empty(2 * ways.entries, np.int16)
        work.run(
            "trails", "lay_directions", len(pores), ways.offsets, ways.others, place, *frame,
            direction, defines=DEFINES,
        )  # fmt: skip
        work.release(*frame)
        return cls(
            len(pores), len(edges), ways, direction, work.upload(edges.length),
            length, work.upload(anisotropy), place, lattice.unit,
            work.upload(place_keys(pores.uv)),
        )  # fmt: skip
