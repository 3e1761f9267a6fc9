"""Grows skin: pores, strengths of the edges between them by walkers, and which edges are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.errors import MeshError
from rhytid.synthesis.assembly import EdgeStrengths, GraphParts
from rhytid.synthesis.drawing import draw
from rhytid.synthesis.edges.candidate_graph import CandidateGraph, Ground
from rhytid.synthesis.edges.rounds import independent_set
from rhytid.synthesis.fields.capacity_check import check_extent, check_uv
from rhytid.synthesis.fields.directions import Directions
from rhytid.synthesis.fields.wanted import EDGES_PER_PORE
from rhytid.synthesis.pores.even_skin import SPACING, WITH_PRIMARY, WITHOUT_PRIMARY
from rhytid.synthesis.pores.pores import packed_radius
from rhytid.synthesis.progress import Progress, part
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.trails.primary import Primary, deepened, has_primary
from rhytid.synthesis.trails.selection import Cut, wishes
from rhytid.synthesis.trails.trails import FINE

# How often pores are scattered again, at most twice as many each time, where there are too few.
ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Skin:
    """Pores `radius` apart and the strengths of their edges.  wish (E,): by which edges are
    chosen."""

    net: CandidateGraph
    radius: float
    strengths: EdgeStrengths
    wish: NDArray[np.float64]

    @property
    def spacing(self) -> float:
        """Mean distance of a pore to the nearest on even skin."""
        return SPACING * self.radius

    def drawn(
        self, ground: Ground, borders: Borders, cut: Cut, seed: int, progress: Progress
    ) -> WrinkleGraph:
        """The graph of the edges down to a cut, in the order of their numbers, which is that of
        space."""
        progress(0.0, "shapes")
        chosen = np.flatnonzero(cut.draws(self.net.edges, self.wish)).astype(np.int32)
        lines = draw(ground, self.net, borders, chosen, self.spacing)
        parts = GraphParts(
            ground, self.net.pores, lines, borders, self.strengths, self.spacing, seed
        )
        return parts.graph(part(progress, 0.1, 1.0))


def counted(
    ground: Ground, settings: GraphSettings, wanted: int, progress: Progress
) -> tuple[Skin, Cut]:
    """Skin with as many pores as it takes for exactly the wanted wrinkles, and the cut at these.

    The first guess is right unless the UV is in small parts, where many edges end at a border:
    there are fewer wrinkles then, if the spacing is set.
    """
    radius = packed_radius(ground.surface, ground.fields, wanted / EDGES_PER_PORE)
    check_uv(ground.surface, settings, radius, ground.fields.least_spacing)
    check_extent(ground.surface, settings, radius * ground.fields.least_spacing)
    for _ in range(ATTEMPTS):
        spinning = part(progress, 0.0, 0.5)
        net = CandidateGraph.spun(ground, radius, settings.neighbours, settings.start, spinning)
        flat = independent_set(ground.work, net.edges.length, net.crossings)
        lines = int(flat.sum())
        if lines >= wanted:
            skin = _worn(ground, net, radius, settings, part(progress, 0.5, 1.0))
            return skin, Cut.at(net.edges, skin.wish, wanted)
        radius *= 0.97 * float(np.sqrt(max(lines / wanted, 0.5)))
    setting, more = "wrinkles", "more wrinkles"
    if settings.wrinkles is None:
        setting, more = "spacing", "a smaller spacing"
    raise MeshError(
        f"graph.{setting} is {getattr(settings, setting)}: only {lines} of {wanted} can be drawn "
        f"between pores so far apart, for the UV of the mesh is in small parts; ask for {more}"
    )


def grown(ground: Ground, radius: float, settings: GraphSettings, progress: Progress) -> Skin:
    """Skin with pores `radius` apart, in units of the surface, times the spacing of its fields."""
    check_uv(ground.surface, settings, radius, ground.fields.least_spacing)
    check_extent(ground.surface, settings, radius * ground.fields.least_spacing)
    net = CandidateGraph.spun(
        ground, radius, settings.neighbours, settings.start, part(progress, 0.0, 0.5)
    )
    return _worn(ground, net, radius, settings, part(progress, 0.5, 1.0))


def _worn(
    ground: Ground, net: CandidateGraph, radius: float, settings: GraphSettings, progress: Progress
) -> Skin:
    """Strengths of the edges, by walkers and primary lines."""
    rng = np.random.Generator(np.random.PCG64(settings.start))
    directions = Directions(SPACING * radius, rng, ground.fields)
    spinning = part(progress, 0.0, 0.07)
    primary = Primary.spun(
        ground, radius, settings.neighbours, settings.start, directions, spinning
    )
    with ground.work.room() as room:
        paths = net.paths(room, directions, ground.fields, part(progress, 0.07, 0.15))
        strength = net.worn(room, paths, settings.start, FINE, part(progress, 0.15, 0.94))
        progress(0.94, "trails")
        weight, hubs = primary.laid(ground, net, paths, radius)
    usual = WITH_PRIMARY if has_primary(ground.surface, radius) else WITHOUT_PRIMARY
    found = EdgeStrengths(deepened(strength, weight), hubs, usual)
    wish = wishes(ground.work, net, found.strength, part(progress, 0.95, 1.0))
    return Skin(net, radius, found, wish)
