"""Pores, the edges that may become wrinkles, and the strengths that walkers give them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.edges.crossings import crossings
from rhytid.synthesis.edges.edges import Edges, candidates
from rhytid.synthesis.fields.directions import Directions
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.pores.even_skin import LENGTH, edges_per_pore
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.pores.pores import scatter_pores
from rhytid.synthesis.progress import Progress, part
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails.paths import Paths
from rhytid.synthesis.trails.trails import Walks, wear
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Ground:
    """The surface that candidate graphs are made on.  across: (F, 3) neighbours of the
    triangles."""

    work: Workspace
    surface: Surface
    across: NDArray[np.int32]
    fields: Fields


@dataclass(frozen=True, eq=False)
class CandidateGraph:
    """Pores, the candidate edges between them, and which of those cross: (P, 2).

    lattice: of the places of pores.  length, degree: typical of edges, and how many there are to a
    pore, on even skin.
    """

    pores: Points
    edges: Edges
    crossings: NDArray[np.int32]
    lattice: Lattice
    length: float
    degree: float

    @classmethod
    def spun(
        cls, ground: Ground, radius: float, count: int, seed: int, progress: Progress
    ) -> CandidateGraph:
        """Pores at least `radius` apart, each joined to its `count` nearest."""
        work, surface, fields = ground.work, ground.surface, ground.fields
        pores = scatter_pores(work, surface, radius, seed, part(progress, 0.0, 0.64), fields)
        joining, crossing = part(progress, 0.64, 0.79), part(progress, 0.79, 0.97)
        edges = candidates(work, surface, ground.across, pores, radius, count, joining, fields)
        lattice = Lattice.absolute(radius, *surface.extent)
        found = crossings(work, pores, edges.nodes, edges.length, crossing, lattice)
        progress(0.97, "crossings")
        return cls(pores, edges, found, lattice, LENGTH * radius, edges_per_pore(count))

    def paths(
        self, work: Workspace, directions: Directions, fields: Fields, progress: Progress
    ) -> Paths:
        """The ways out of the pores against the preferred directions."""
        along, left = directions.frames(self.pores, progress)
        anisotropy = fields.anisotropy(self.pores.triangle, self.pores.uv)
        return Paths.of(
            work, self.pores, self.edges, along, left, anisotropy, self.lattice, self.length
        )

    def worn(
        self, work: Workspace, paths: Paths, seed: int, walks: Walks, progress: Progress
    ) -> NDArray[np.float32]:
        """(E,) the strengths that walkers give the edges; the mean is near 1 on even skin."""
        progress(0.0, "trails")
        return wear(work, paths, self.crossings, seed, self.degree, walks, progress)
