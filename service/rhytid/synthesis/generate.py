"""From a mesh to its wrinkle graph: pores, candidate edges, trails, shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.controls import Controls
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.synthesis.amount import FEWEST, check_extent, check_uv, wrinkles_in_all
from rhytid.synthesis.assembly import Worn, assemble
from rhytid.synthesis.borders import Borders
from rhytid.synthesis.charts import neighbours
from rhytid.synthesis.directions import Directions
from rhytid.synthesis.drawing import draw, lines_of, stored
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.independent import independent_set
from rhytid.synthesis.net import Ground, Net
from rhytid.synthesis.painting import fields_of
from rhytid.synthesis.pores import packed_radius
from rhytid.synthesis.primary import Primary, deepened
from rhytid.synthesis.progress import Progress, part, rising, silent
from rhytid.synthesis.rooms import spacings
from rhytid.synthesis.selection import preference
from rhytid.synthesis.spacing import mean_spacing
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.wanted import EDGES_PER_PORE
from rhytid.synthesis.workspace import Caller, Workspace, directly

# How often the pores are scattered anew, at most twice as many, where that gives too few.
ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A graph and what came up while it was made.

    spacing: distance of a pore to the nearest, on the surface, mesh units, where nothing is
    painted: as the settings have it, with their density; where they say how many wrinkles there
    are, as it came out, over the mean of what differs from place to place.  distance: the mean as
    it came out.
    stretched: how many triangles hold no pore because their UV is stretched beyond reason.
    """

    graph: WrinkleGraph
    spacing: float
    distance: float
    stretched: int


def synthesize(
    mesh: Mesh,
    settings: GraphSettings,
    device: Device,
    progress: Progress = silent,
    fields: Fields | None = None,
    call: Caller = directly,
    controls: Controls | None = None,
) -> Synthesis:
    """A graph after Weiss et al. 2023, of exactly `settings.wrinkles` wrinkles where density is 1,
    or of pores `settings.spacing` apart there.

    The same mesh, settings, seed and device give the same graph, bit for bit; so does the mesh
    scaled by a power of two, and the spacing with it. progress(fraction, stage) is called often and
    may raise CancelledError. fields: what differs from place to place, in place of what settings
    and controls say of it. call: runs each step on the device's thread. Raises MeshError where the
    mesh has no room for pores, or its UV none for the wrinkles, and what `wrinkles_in_all` does.
    """
    report = rising(progress)
    report(0.0, "pores")
    surface, across = Surface.of(mesh), neighbours(mesh)
    fields = fields or fields_of(surface, settings, controls)
    wanted = wrinkles_in_all(surface, settings, fields, device.budget.limit)
    rng = np.random.Generator(np.random.PCG64(settings.seed))
    with Workspace(device, call) as work:
        ground = Ground(work, surface, across, fields)
        net, radius, wanted = _net(ground, settings, wanted, part(report, 0.0, 0.48))
        distance = mean_spacing(work, net.pores)[0]
        factor = spacings(fields, net.pores.triangle, net.pores.uv)
        spacing = distance / float(factor.mean(dtype=np.float64))
        directions = Directions(spacing, rng, fields)
        worn = _worn(ground, net, settings, radius, directions, part(report, 0.48, 0.92))
        order = preference(work, net, worn.strength, part(report, 0.92, 0.945))
    report(0.945, "shapes")
    chosen, borders = stored(order, wanted), Borders.of(mesh, surface, across)
    report(0.947, "shapes")
    lines = draw(ground, net, borders, chosen, spacing)
    shaping = part(report, 0.95, 1.0)
    graph = assemble(ground, net.pores, lines, borders, worn, spacing, rng, shaping)
    report(1.0, "shapes")
    spacing *= surface.scale
    if settings.wrinkles is None and settings.spacing is not None:
        spacing = settings.spacing * settings.density**-0.5
    return Synthesis(graph, spacing, distance * surface.scale, surface.stretched)


def _net(
    ground: Ground, settings: GraphSettings, wanted: int, progress: Progress
) -> tuple[Net, float, int]:
    """As many pores as it takes for the wanted wrinkles, their disc radius, and how many wrinkles
    there will be.

    The first guess holds but for a mesh in shreds, where many edges end at a border: there are
    fewer then, if it is the spacing that is set.
    """
    radius = packed_radius(ground.surface, ground.fields, wanted / EDGES_PER_PORE)
    check_uv(ground.surface, settings, radius, ground.fields.least_spacing)
    check_extent(ground.surface, settings, radius * ground.fields.least_spacing)
    for _ in range(ATTEMPTS):
        spinning = part(progress, 0.0, 0.98)
        net = Net.spun(ground, radius, settings.neighbours, settings.seed, spinning)
        flat = independent_set(ground.work, net.edges.length, net.crossings)
        lines = lines_of(net.edges.take(flat))
        if settings.wrinkles is None and lines >= FEWEST:
            return net, radius, min(lines, wanted)
        if lines >= wanted:
            return net, radius, wanted
        radius *= 0.97 * float(np.sqrt(max(lines / wanted, 0.5)))
    told, more = "wrinkles", "more wrinkles"
    if settings.wrinkles is None:
        told, more = "spacing", "a smaller spacing"
    raise MeshError(
        f"graph.{told} is {getattr(settings, told)}: only {lines} of {wanted} can be drawn between "
        f"pores so far apart, for the UV of the mesh is in small parts; ask for {more}"
    )


def _worn(
    ground: Ground,
    net: Net,
    settings: GraphSettings,
    radius: float,
    directions: Directions,
    progress: Progress,
) -> Worn:
    """How strong walkers and primary lines make the edges."""
    spinning = part(progress, 0.0, 0.07)
    primary = Primary.spun(ground, radius, settings.neighbours, settings.seed, directions, spinning)
    with ground.work.room() as room:
        paths = net.paths(room, directions, ground.fields, part(progress, 0.07, 0.15))
        strength = net.worn(room, paths, settings.seed, part(progress, 0.15, 0.98))
        progress(0.98, "trails")
        weight, hubs = primary.laid(ground, net, paths, radius)
    progress(1.0, "selection")
    return Worn(deepened(strength, weight), hubs)
