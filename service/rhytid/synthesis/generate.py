"""From a mesh to its wrinkle graph: pores, candidate edges, trails, shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.synthesis import shapes
from rhytid.synthesis.charts import neighbours
from rhytid.synthesis.crossings import crossings
from rhytid.synthesis.directions import preferred_directions
from rhytid.synthesis.drawing import Lines, draw, lines_of, stored
from rhytid.synthesis.edges import REACH, Edges, candidates
from rhytid.synthesis.independent import independent_set
from rhytid.synthesis.paths import Paths
from rhytid.synthesis.pores import PACKING, mean_spacing, scatter_pores
from rhytid.synthesis.progress import Progress, part, silent
from rhytid.synthesis.selection import preference
from rhytid.synthesis.surface import FloatArray, IntArray, Points, Surface
from rhytid.synthesis.trails import wear

# Wrinkles per pore; a triangulation would have three.
EDGES_PER_PORE = 2.1
# How often the pores are scattered anew, at most twice as many, where that gives too few.
ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A graph and what came up while it was made.

    spacing: mean distance of a pore to the nearest, on the surface, mesh units.
    stretched: how many triangles hold no pore because their UV is stretched beyond reason.
    """

    graph: WrinkleGraph
    spacing: float
    stretched: int


@dataclass(frozen=True, eq=False)
class Net:
    """Pores, the edges that may become wrinkles, and which of those cross: (P, 2)."""

    pores: Points
    edges: Edges
    crossings: IntArray
    spacing: float


def synthesize(mesh: Mesh, settings: GraphSettings, progress: Progress = silent) -> Synthesis:
    """A graph of exactly `settings.wrinkles` wrinkles, after Weiss et al. 2023.

    The same mesh, settings and seed give the same graph, bit for bit; so does the mesh scaled by
    a power of two. progress(fraction, stage) is called often and may raise CancelledError. Raises
    MeshError where the mesh has no room for pores, or its UV none for the wrinkles.
    """
    rng = np.random.Generator(np.random.PCG64(settings.seed))
    surface, across = Surface.of(mesh), neighbours(mesh)
    net = _net(surface, across, settings, rng, part(progress, 0.0, 0.5))
    along, left = preferred_directions(net.pores, net.spacing, rng)
    paths = Paths.of(net.pores, net.edges.nodes, along, left)
    trails = part(progress, 0.5, 0.95)
    strength = wear(paths, net.edges.length, net.crossings, rng, trails)
    progress(0.95, "shapes")
    order = preference(len(net.pores), net.edges, strength, net.crossings)
    edge, side = stored(net.edges, order, settings.wrinkles)
    lines = draw(surface, across, net.pores, net.edges, edge, side, net.spacing)
    graph = _graph(surface, net, lines, strength[edge], rng)
    progress(1.0, "shapes")
    return Synthesis(graph, net.spacing * surface.scale, surface.stretched)


def _net(
    surface: Surface,
    across: IntArray,
    settings: GraphSettings,
    rng: np.random.Generator,
    progress: Progress,
) -> Net:
    """As many pores as it takes for the wanted wrinkles.

    The first guess holds but for a mesh in shreds, where many edges end at a border.
    """
    radius = float(np.sqrt(PACKING * EDGES_PER_PORE / settings.wrinkles))
    for _ in range(ATTEMPTS):
        pores = scatter_pores(surface, radius, rng, part(progress, 0.0, 0.7))
        progress(0.7, "edges")
        edges = candidates(surface, across, pores, radius, settings.neighbours)
        found = crossings(pores, edges.nodes, edges.length, part(progress, 0.8, 1.0))
        lines = lines_of(edges.take(independent_set(len(edges), found)))
        if lines >= settings.wrinkles:
            return Net(pores, edges, found, mean_spacing(pores, REACH * radius)[0])
        radius *= 0.97 * float(np.sqrt(max(lines / settings.wrinkles, 0.5)))
    wanted = settings.wrinkles
    raise MeshError(f"the UV of the mesh has room for {lines} wrinkles: graph.wrinkles is {wanted}")


def _graph(
    surface: Surface, net: Net, lines: Lines, strength: FloatArray, rng: np.random.Generator
) -> WrinkleGraph:
    """Weights and sizes; nodes beyond a border are as large as their pore and not drawn."""
    pores, count = net.pores, len(net.pores)
    weight = shapes.edge_weights(strength)
    width = shapes.widths(weight, net.spacing)
    size = shapes.pore_sizes(pores.position, net.spacing, rng)
    depth = shapes.pore_weights(lines.nodes, weight, size, rng)
    metric, radius = shapes.pore_ellipses(surface, pores.triangle, size)
    half_width = shapes.half_widths_uv(surface, lines.triangle, lines.step, width)
    source = np.concatenate([np.arange(count), lines.owner])
    return WrinkleGraph(
        node_uv=np.concatenate([pores.uv, lines.beyond]),
        node_weight=np.concatenate([depth, np.zeros(len(lines.owner))]),
        node_radius=radius[source],
        node_metric=metric[source],
        node_triangle=pores.triangle[source],
        edge_nodes=lines.nodes.astype(np.int32),
        edge_weight=weight.astype(np.float32),
        edge_half_width=half_width.astype(np.float32),
        edge_triangle=lines.triangle.astype(np.int32),
    )
