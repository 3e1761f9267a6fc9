"""From a mesh to its wrinkle graph: pores, candidate edges, trails, shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.synthesis.assembly import assemble
from rhytid.synthesis.charts import neighbours
from rhytid.synthesis.crossings import crossings
from rhytid.synthesis.directions import preferred_directions
from rhytid.synthesis.drawing import draw, lines_of, stored
from rhytid.synthesis.edges import Edges, candidates
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.independent import independent_set
from rhytid.synthesis.paths import Paths
from rhytid.synthesis.pores import packed_radius, scatter_pores
from rhytid.synthesis.progress import Clock, Progress, part, silent
from rhytid.synthesis.selection import preference
from rhytid.synthesis.spacing import mean_spacing
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import wear
from rhytid.synthesis.workspace import Caller, Workspace, directly

# Wrinkles per pore; a triangulation would have three.
EDGES_PER_PORE = 2.1
# How often the pores are scattered anew, at most twice as many, where that gives too few.
ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A graph and what came up while it was made.

    spacing: mean distance of a pore to the nearest, on the surface, mesh units.
    stretched: how many triangles hold no pore because their UV is stretched beyond reason.
    seconds: by stage.
    """

    graph: WrinkleGraph
    spacing: float
    stretched: int
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False)
class Net:
    """Pores, the edges that may become wrinkles, and which of those cross: (P, 2)."""

    pores: Points
    edges: Edges
    crossings: NDArray[np.int32]
    spacing: float


def synthesize(
    mesh: Mesh,
    settings: GraphSettings,
    device: Device,
    progress: Progress = silent,
    fields: Fields | None = None,
    call: Caller = directly,
) -> Synthesis:
    """A graph of exactly `settings.wrinkles` wrinkles, after Weiss et al. 2023.

    The same mesh, settings, seed and device give the same graph, bit for bit; so does the mesh
    scaled by a power of two. progress(fraction, stage) is called often and may raise
    CancelledError. fields: what differs from place to place. call: runs each step on the device's
    thread. Raises MeshError where the mesh has no room for pores, or its UV none for the wrinkles.
    """
    clock, fields = Clock(progress), fields or Fields()
    clock(0.0, "pores")
    surface, across = Surface.of(mesh), neighbours(mesh)
    rng = np.random.Generator(np.random.PCG64(settings.seed))
    with Workspace(device, call) as work:
        net = _net(work, surface, across, settings, fields, part(clock, 0.0, 0.6))
        strength = _worn(work, net, fields, settings.seed, rng, part(clock, 0.6, 0.9))
        order = preference(
            work, len(net.pores), net.edges, strength, net.crossings, part(clock, 0.9, 0.94)
        )
    clock(0.94, "shapes")
    edge, side = stored(net.edges, order, settings.wrinkles)
    lines = draw(surface, across, net.pores, net.edges, edge, side, net.spacing)
    graph = assemble(
        surface, net.pores, lines, strength, net.spacing, rng, fields, part(clock, 0.95, 1.0)
    )
    clock(1.0, "shapes")
    return Synthesis(graph, net.spacing * surface.scale, surface.stretched, clock.seconds)


def _net(
    work: Workspace,
    surface: Surface,
    across: NDArray[np.int32],
    settings: GraphSettings,
    fields: Fields,
    progress: Progress,
) -> Net:
    """As many pores as it takes for the wanted wrinkles.

    The first guess holds but for a mesh in shreds, where many edges end at a border.
    """
    wanted = settings.wrinkles
    radius = packed_radius(surface, fields, wanted / EDGES_PER_PORE)
    for _ in range(ATTEMPTS):
        scattering = part(progress, 0.0, 0.5)
        pores = scatter_pores(work, surface, radius, settings.seed, scattering, fields)
        edges = candidates(
            work, surface, across, pores, radius, settings.neighbours, part(progress, 0.5, 0.8),
            fields,
        )  # fmt: skip
        found = crossings(work, pores, edges.nodes, edges.length, part(progress, 0.8, 0.97))
        progress(0.97, "crossings")
        flat = edges.take(independent_set(work, edges.length, found))
        lines = lines_of(flat)
        if lines >= wanted:
            return Net(pores, edges, found, mean_spacing(work, pores)[0])
        radius *= 0.97 * float(np.sqrt(max(lines / wanted, 0.5)))
    raise MeshError(f"the UV of the mesh has room for {lines} wrinkles: graph.wrinkles is {wanted}")


def _worn(
    work: Workspace,
    net: Net,
    fields: Fields,
    seed: int,
    rng: np.random.Generator,
    progress: Progress,
) -> NDArray[np.float32]:
    """(E,) how strong walkers make the edges."""
    along, left = preferred_directions(
        net.pores, net.spacing, rng, part(progress, 0.0, 0.15), fields
    )
    progress(0.15, "trails")
    anisotropy = fields.anisotropy(net.pores.triangle, net.pores.uv)
    with work.room() as room:
        paths = Paths.of(room, net.pores, net.edges, along, left, anisotropy)
        del along, left
        return wear(room, paths, net.crossings, seed, part(progress, 0.2, 1.0))
