"""Pores, the edges that may become wrinkles, the strengths that walkers give them, and which of the
edges are drawn. Kernel: independent.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.edges import Edges, candidates, crossings
from rhytid.synthesis.fields import Directions, Fields, looked_up
from rhytid.synthesis.incidence import KEPT, NEEDED, Incidence, chosen
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.pore_density import LENGTH, edges_per_pore
from rhytid.synthesis.pores import scatter_around
from rhytid.synthesis.progress import Progress, nth_largest, over_rows, part, rows_where
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import Paths, Walks, wear
from rhytid.synthesis.workspace import Workspace

# Every pore keeps so many of its edges before the strength alone decides: polygons close, and
# no wrinkle ends nowhere.
ENDS = 3
# Between the classes of edges: more than any strength.
_CLASS = 1024.0


@dataclass(frozen=True, eq=False)
class Ground:
    """A surface with its fields and a workspace on the device, to make candidate graphs on.

    across: (F, 3) neighbours of the triangles.  borders: of the charts; None where nothing is to
    cross them.  unit: of the mesh, None where it is not known.
    """

    work: Workspace
    surface: Surface
    across: NDArray[np.int32]
    fields: Fields
    borders: Borders | None = None
    unit: str | None = None


@dataclass(frozen=True, eq=False)
class CandidateGraph:
    """Pores and the candidate edges between them.

    crossings: (P, 2) pairs of edges that cross.  lattice: of the places of pores.  length, degree:
    on even skin, the mean length of edges and their number per pore.  first (L,): the pores that
    were there first.  nearest (N,): the distance of each pore to the nearest, infinity where none
    is within reach of an edge.
    """

    pores: Points
    edges: Edges
    crossings: NDArray[np.int32]
    lattice: Lattice
    length: float
    degree: float
    first: NDArray[np.int32]
    nearest: NDArray[np.float32]

    @classmethod
    def build(
        cls,
        ground: Ground,
        radius: float,
        count: int,
        seed: int,
        progress: Progress,
        first: Points | None = None,
    ) -> CandidateGraph:
        """Pores at least `radius` apart, around those that are there first, each joined to its
        `count` nearest."""
        work, surface, fields = ground.work, ground.surface, ground.fields
        scattering = part(progress, 0.0, 0.48)
        pores, at = scatter_around(work, surface, radius, seed, scattering, fields, first)
        joining, crossing = part(progress, 0.48, 0.66), part(progress, 0.66, 0.99)
        edges, nearest = candidates(
            work, surface, ground.across, pores, radius, count, joining, fields
        )
        lattice = Lattice.absolute(radius, *surface.extent)
        found = crossings(work, pores, edges.nodes, edges.length, crossing, lattice)
        progress(0.99, "crossings")
        return cls(
            pores, edges, found, lattice, LENGTH * radius, edges_per_pore(count), at, nearest
        )

    def paths(
        self, work: Workspace, directions: Directions, fields: Fields, progress: Progress
    ) -> Paths:
        """The edges that leave each pore, measured against the preferred directions."""
        along, left = directions.frames(self.pores, progress)
        anisotropy = looked_up(fields.anisotropy, self.pores)
        return Paths.of(
            work, self.pores, self.edges, along, left, anisotropy, self.lattice, self.length
        )

    def worn(
        self,
        work: Workspace,
        paths: Paths,
        seed: int,
        walks: Walks,
        progress: Progress,
        worn: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """(E,) the strength that walkers give each edge; the mean is near 1 on even skin.

        worn (E,): strengths that the first of them find.
        """
        progress(0.0, "trails")
        return wear(work, paths, self.crossings, seed, self.degree, walks, progress, worn)


def priorities(
    work: Workspace, net: CandidateGraph, strength: NDArray[np.float32], progress: Progress
) -> NDArray[np.float64]:
    """(E,) the priority of each edge of a net, from the strengths (E,).

    Edges come in three classes: first those among the ENDS strongest of a pore that cross nothing
    stronger, then the others that cross nothing stronger, then the rest. Within a class the
    stronger edge has the higher priority.
    """
    mark = _marks(work, net, strength, progress)
    priority, of_class = np.empty(len(strength)), np.zeros(NEEDED + 1)
    of_class[[KEPT, NEEDED]] = _CLASS, 2.0 * _CLASS

    def add(rows: slice) -> None:
        priority[rows] = strength[rows] + of_class[mark[rows]]

    over_rows(len(priority), add)
    progress(1.0, "selection")
    return priority


@dataclass(frozen=True)
class Cut:
    """Down to which edge a net is drawn: the priority and length of the last."""

    priority: float
    length: float = np.inf

    @classmethod
    def at_strength(cls, strength: float) -> Cut:
        """The cut that draws all edges that pores need, and of the others that cross nothing
        stronger those stronger than `strength`."""
        return cls(_CLASS + strength)

    @classmethod
    def at_count(cls, edges: Edges, priority: NDArray[np.float64], count: int) -> Cut:
        """The cut that draws exactly `count` edges, of equal priority the shorter ones first."""
        least = nth_largest(priority, count)
        tied = rows_where(len(priority), lambda rows: priority[rows] == least)
        left = count - len(rows_where(len(priority), lambda rows: priority[rows] > least))
        return cls(least, float(np.partition(edges.length[tied], left - 1)[left - 1]))

    def drawn(self, edges: Edges, priority: NDArray[np.float64]) -> NDArray[np.int32]:
        """The numbers of the edges that are drawn, ascending; whether one is depends on that edge
        alone."""

        def draws(rows: slice) -> NDArray[np.bool_]:
            even = (priority[rows] == self.priority) & (edges.length[rows] <= self.length)
            found: NDArray[np.bool_] = (priority[rows] > self.priority) | even
            return found

        return rows_where(len(priority), draws)


def _marks(
    work: Workspace, net: CandidateGraph, strength: NDArray[np.float32], progress: Progress
) -> NDArray[np.uint8]:
    """(E,) NEEDED, KEPT or DROPPED."""
    count, crossings = len(net.edges), net.crossings
    progress(0.0, "selection")
    with work.nested() as nested:
        key = nested.lend(-strength)
        conflicts = Incidence.of(nested, nested.lend(crossings), len(crossings), count)
        progress(0.2, "selection")
        state = chosen(nested, key, count, conflicts)
        progress(0.5, "selection")
        nodes, marked = nested.lend(net.edges.nodes), nested.readable(count, np.uint8)
        lists = Incidence.of(nested, nodes, count, len(net.pores))
        progress(0.8, "selection")
        nested.run(
            "independent", "mark_needed", count, ENDS, key, nodes, lists.offsets, lists.pairs,
            state, marked,
        )  # fmt: skip
        found: NDArray[np.uint8] = nested.read(marked, (count,), np.uint8)
    return found
