"""From a mesh to its wrinkle graph: pores, candidate edges, trails, shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.lengths import Lengths, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import COARSE
from rhytid.errors import MeshError
from rhytid.support.heap import give_back_heap
from rhytid.synthesis.assembly import EdgeStrengths, GraphParts, graph_of
from rhytid.synthesis.build_size import shares_of_time
from rhytid.synthesis.candidate_graph import CandidateGraph, Cut, Ground, priorities
from rhytid.synthesis.capacity import check_drawn, check_radius, wrinkles_in_all
from rhytid.synthesis.events import Events, events_of
from rhytid.synthesis.fields import Directions, Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.incidence import independent_set
from rhytid.synthesis.leaders import LeaderPores, Leaders, leaders_of
from rhytid.synthesis.lines import draw
from rhytid.synthesis.painted_fields import fields_of
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.pore_density import (
    EDGES_PER_PORE,
    SPACING,
    WITH_PRIMARY,
    WITHOUT_PRIMARY,
    faintest,
)
from rhytid.synthesis.pores import packed_radius
from rhytid.synthesis.primary_lines import Primary, has_primary_lines, with_primary_lines
from rhytid.synthesis.progress import Progress, part, rising, silent
from rhytid.synthesis.ranks import Ranks
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.statistics import mean_spacing
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.trails import FINE
from rhytid.synthesis.workspace import Caller, Workspace, directly

# How often pores are scattered again, at most twice as many each time, where there are too few.
ATTEMPTS = 4
# Of the time between the first pore and copies over seams: growing, and of that the net of pores;
# the rest is shapes. These and the shares below are those of 600,000 to 20 million wrinkles.
_GROWN, _NET = 0.79, 0.57


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A synthesised graph, and figures of it.

    lengths: that the graph is drawn with unless settings say otherwise. Their spacing is the
    distance on the surface from a pore to the nearest, mesh units, where nothing is painted: that
    of the settings, with their density; or, where the settings give the number of wrinkles, the
    mean on even skin with so many. Their depth is that of the age in the settings.  distance: the
    mean distance from a pore to the nearest in the graph, mesh units.  stretched: how many
    triangles hold no pore because their UV is stretched too far.
    """

    graph: WrinkleGraph
    lengths: Lengths
    distance: float
    stretched: int

    @property
    def spacing(self) -> float:
        """The spacing of the lengths, mesh units."""
        return self.lengths.spacing


def synthesize(
    mesh: Mesh,
    settings: GraphSettings,
    device: Device,
    progress: Progress = silent,
    fields: Fields | None = None,
    call: Caller = directly,
    controls: Controls | None = None,
    folds: Folds | None = None,
    unit: str | None = None,
) -> Synthesis:
    """Grow a wrinkle graph on a mesh, after Weiss et al. 2023.

    Where nothing is painted it has exactly `settings.wrinkles` wrinkles times density, or pores
    `settings.spacing` apart.

    The same mesh, settings, seed and device give the same graph, bit for bit; so does the mesh
    scaled by a power of two, and the spacing with it. What is painted changes only its
    surroundings: where the number of wrinkles is set and something is painted that pores and lines
    grow by, the skin without it is grown first. That skin says how far apart pores are and which
    edges are too faint.

    progress(fraction, stage): called often; may raise CancelledError.  fields: properties of the
    skin by place, in place of those of settings, controls and folds.  folds: where the face folds;
    lines run across the folds, without them around the vertical axis.  unit: of the mesh, for
    lengths in millimetres; without it these follow from the spacing of pores.  call: runs each step
    in a task of the device.
    Raises MeshError where the mesh has no room for pores, or its UV has none for the wrinkles;
    InputError and LimitError as `wrinkles_in_all` does.
    """
    report = rising(progress)
    report(0.0, "pores")
    surface, across = Surface.of(mesh), neighbours(mesh)
    folding = None
    if folds is not None:
        fine = settings.anatomy != COARSE
        folding = FoldField(mesh, surface, folds, settings.age, settings.rank, cautious=fine)
    patches = Patches.of(surface, settings, unit)
    plain = fields_of(surface, settings, None, folding, patches)
    uneven = fields is not None or (controls is not None and controls.grow)
    fields = fields or fields_of(surface, settings, controls, folding, patches)
    many = wrinkles_in_all(surface, settings, fields, device.budget.limit)
    begun, copying = shares_of_time(mesh, across, many)
    grown = begun + _GROWN * (1.0 - begun - copying)
    with Workspace(device, call) as work:
        borders = Borders.of(mesh, surface, across)
        ground = Ground(work, surface, across, fields, borders, unit)
        skin, cut = _skin(ground, plain if uneven else fields, settings, part(report, begun, grown))
        distance = _distance(work, skin.net) * surface.scale
        events = events_of(surface, fields, settings, skin.spacing, unit)
        shaping, spacing = part(report, grown, 1.0 - copying), skin.spacing
        parts = skin.drawn(ground, borders, cut, settings.start, shaping, events)
        del skin  # most of its memory is needed for the arrays of the graph
        give_back_heap()
        arrays = parts.arrays(part(shaping, 0.1, 1.0), part(report, 1.0 - copying, 1.0))
        del parts
        graph = graph_of(arrays)
        give_back_heap()
    if patches is not None and unit is not None and millimetres(unit) is None:
        graph = graph.with_origin(GraphOrigin(unit, patch_size=patches.size))
    report(1.0, "shapes")
    lengths = Lengths.of(spacing * surface.scale, settings.age)
    return Synthesis(graph, lengths, distance, surface.stretched)


def _distance(work: Workspace, net: CandidateGraph) -> float:
    """The mean distance of a pore to the nearest: of those within reach of an edge, which are
    nearly all; where none is, as far as it takes."""
    found = net.nearest[np.isfinite(net.nearest)]
    return float(found.mean(dtype=np.float64)) if len(found) else mean_spacing(work, net.pores)[0]


def _skin(
    ground: Ground, plain: Fields, settings: GraphSettings, progress: Progress
) -> tuple[Skin, Cut]:
    """The skin, and the cut down to which its edges are drawn.

    plain: the fields where nothing is painted.
    """
    surface = ground.surface
    if settings.wrinkles is None:
        assert settings.spacing is not None
        spacing = settings.spacing * settings.density**-0.5 / surface.scale
        skin = _grown_at_spacing(ground, spacing / SPACING, settings, progress)
        cut = Cut.at_strength(faintest(settings.neighbours))
        check_drawn(surface, settings, len(cut.drawn(skin.net.edges, skin.priority)))
        return skin, cut
    first = ground if plain is ground.fields else replace(ground, fields=plain)
    count = wrinkles_in_all(surface, settings, plain)
    half = 1.0 if first is ground else 0.5
    skin, cut = _grown_to_count(first, settings, count, part(progress, 0.0, half))
    if first is not ground:
        skin = _grown_at_spacing(ground, skin.radius, settings, part(progress, half, 1.0))
    return skin, cut


@dataclass(frozen=True, eq=False)
class Skin:
    """Pores `radius` apart, and the strengths of the edges between them.

    priority (E,): by which edges are chosen to be drawn.
    """

    net: CandidateGraph
    radius: float
    strengths: EdgeStrengths
    priority: NDArray[np.float64]

    @property
    def spacing(self) -> float:
        """Mean distance of a pore to the nearest on even skin."""
        return SPACING * self.radius

    def drawn(
        self,
        ground: Ground,
        borders: Borders,
        cut: Cut,
        seed: int,
        progress: Progress,
        events: Events | None = None,
    ) -> GraphParts:
        """The parts of a graph of the edges down to `cut`, in spatial order."""
        progress(0.0, "shapes")
        chosen = cut.drawn(self.net.edges, self.priority)
        lines = draw(ground, self.net, borders, chosen, self.spacing)
        return GraphParts(
            ground, self.net.pores, lines, borders, self.strengths, self.spacing, seed, events
        )


def _grown_to_count(
    ground: Ground, settings: GraphSettings, count: int, progress: Progress
) -> tuple[Skin, Cut]:
    """Skin with as many pores as `count` wrinkles need, and the cut that leaves exactly these.

    The first guess of the radius is right unless the UV is in small parts, where many edges end at
    a border and cannot be drawn.
    """
    radius = packed_radius(ground.surface, ground.fields, count / EDGES_PER_PORE)
    check_radius(ground.surface, settings, radius, ground.fields.least_spacing)
    leaders = leaders_of(ground, SPACING * radius, settings)
    for _ in range(ATTEMPTS):
        building, first = part(progress, 0.0, _NET), _pores_on(leaders, radius)
        net = CandidateGraph.build(
            ground, radius, settings.neighbours, settings.start, building, first.points
        )
        drawable = independent_set(ground.work, net.edges.length, net.crossings)
        lines = int(drawable.sum())
        if lines >= count:
            skin = _worn(ground, net, first, radius, settings, part(progress, _NET, 1.0))
            return skin, Cut.at_count(net.edges, skin.priority, count)
        radius *= 0.97 * float(np.sqrt(max(lines / count, 0.5)))
    setting, more = "wrinkles", "more wrinkles"
    if settings.wrinkles is None:
        setting, more = "spacing", "a smaller spacing"
    raise MeshError(
        f"graph.{setting} is {getattr(settings, setting)}: only {lines} of {count} can be drawn "
        f"between pores so far apart, for the UV of the mesh is in small parts; ask for {more}"
    )


def _grown_at_spacing(
    ground: Ground, radius: float, settings: GraphSettings, progress: Progress
) -> Skin:
    """Skin with pores `radius` apart, in units of the surface, times the spacing of its fields."""
    check_radius(ground.surface, settings, radius, ground.fields.least_spacing)
    first = _pores_on(leaders_of(ground, SPACING * radius, settings), radius)
    building = part(progress, 0.0, _NET)
    net = CandidateGraph.build(
        ground, radius, settings.neighbours, settings.start, building, first.points
    )
    return _worn(ground, net, first, radius, settings, part(progress, _NET, 1.0))


def _pores_on(leaders: Leaders | None, radius: float) -> LeaderPores:
    return LeaderPores.none() if leaders is None else leaders.pores(radius)


def _worn(
    ground: Ground,
    net: CandidateGraph,
    leaders: LeaderPores,
    radius: float,
    settings: GraphSettings,
    progress: Progress,
) -> Skin:
    """The skin of a net: strengths of its edges, by leaders, walkers and primary lines."""
    ranks = None
    if len(leaders):
        ranks = Ranks.of(net, leaders, ground.fields, SPACING * radius, settings)
    rng = np.random.Generator(np.random.PCG64(settings.start))
    directions = Directions(SPACING * radius, rng, ground.fields)
    give_back_heap()  # nothing takes more memory than walkers
    building = part(progress, 0.0, 0.12)
    primary = Primary.build(
        ground, radius, settings.neighbours, settings.start, directions, building
    )
    with ground.work.nested() as nested:
        paths = net.paths(nested, directions, ground.fields, part(progress, 0.12, 0.37))
        wearing, worn = part(progress, 0.37, 0.9), None if ranks is None else ranks.worn()
        strength = net.worn(nested, paths, settings.start, FINE, wearing, worn)
        progress(0.9, "trails")
        weight, hubs = primary.laid(ground, net, paths, radius)
    usual = WITH_PRIMARY if has_primary_lines(ground.surface, radius) else WITHOUT_PRIMARY
    strength = with_primary_lines(strength, weight)
    if ranks is not None:
        strength = ranks.raised(strength)
    found = EdgeStrengths(strength, hubs, usual, ranks)
    priority = priorities(ground.work, net, found.strength, part(progress, 0.91, 1.0))
    return Skin(net, radius, found, priority)
