"""From a mesh to its wrinkle graph: pores, candidate edges, trails, shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.synthesis.edges.candidate_graph import Ground
from rhytid.synthesis.fields.capacity_check import check_drawn, wrinkles_in_all
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.fields.folding import FoldField
from rhytid.synthesis.fields.painting import fields_of
from rhytid.synthesis.pores.even_skin import SPACING, faintest
from rhytid.synthesis.pores.spacing import mean_spacing
from rhytid.synthesis.progress import Progress, part, rising, silent
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.trails.growth import Skin, counted, grown
from rhytid.synthesis.trails.selection import Cut, flat
from rhytid.synthesis.workspace import Caller, Workspace, directly


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A graph and what came up while it was made.

    lengths: what it is drawn with unless settings say otherwise. Their spacing is the distance of a
    pore to the nearest, on the surface, mesh units, where nothing is painted: as the settings have
    it, with their density; where they say how many wrinkles there are, the mean on even skin of so
    many. Their depth is that of the age of the settings.  distance: the mean as it came out.
    stretched: how many triangles hold no pore because their UV is stretched beyond reason.
    """

    graph: WrinkleGraph
    lengths: Lengths
    distance: float
    stretched: int

    @property
    def spacing(self) -> float:
        """Of the lengths."""
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
) -> Synthesis:
    """A graph after Weiss et al. 2023, of exactly `settings.wrinkles` wrinkles times density
    where nothing is painted, or of pores `settings.spacing` apart there.

    The same mesh, settings, seed and device give the same graph, bit for bit; so does the mesh
    scaled by a power of two, and the spacing with it. What is painted changes only its
    surroundings: where the number of wrinkles is set and something is painted that pores and lines
    grow by, the skin without it is grown first, which says how far apart pores are and which edges
    are too faint.

    progress(fraction, stage) is called often and may raise CancelledError. fields: what differs
    from place to place, in place of what settings, controls and folds say of it. folds: where the
    face folds, for lines to run there; without them these run level. call: runs each step in
    a task of the device. Raises MeshError where the mesh has no room for pores, or its UV none for
    the wrinkles, and what `wrinkles_in_all` does.
    """
    report = rising(progress)
    report(0.0, "pores")
    surface, across = Surface.of(mesh), neighbours(mesh)
    folding = None if folds is None else FoldField(mesh, surface, folds, settings.age)
    plain = fields_of(surface, settings, None, folding)
    uneven = fields is not None or (controls is not None and controls.grow)
    fields = fields or fields_of(surface, settings, controls, folding)
    wrinkles_in_all(surface, settings, fields, device.budget.limit)
    with Workspace(device, call) as work:
        ground = Ground(work, surface, across, fields)
        skin, cut = _grown(ground, plain if uneven else fields, settings, part(report, 0.0, 0.94))
        distance = mean_spacing(work, skin.net.pores)[0] * surface.scale
        borders = Borders.of(mesh, surface, across)
        graph = skin.drawn(ground, borders, cut, settings.start, part(report, 0.95, 1.0))
    report(1.0, "shapes")
    lengths = Lengths.of(skin.spacing * surface.scale, settings.age)
    return Synthesis(graph, lengths, distance, surface.stretched)


def _grown(
    ground: Ground, plain: Fields, settings: GraphSettings, progress: Progress
) -> tuple[Skin, Cut]:
    """Skin, and down to where its edges are drawn.  plain: fields where nothing is painted."""
    surface = ground.surface
    if settings.wrinkles is None:
        assert settings.spacing is not None
        spacing = settings.spacing * settings.density**-0.5 / surface.scale
        skin = grown(ground, spacing / SPACING, settings, progress)
        cut = flat(faintest(settings.neighbours))
        check_drawn(surface, settings, int(cut.draws(skin.net.edges, skin.wish).sum()))
        return skin, cut
    first = ground if plain is ground.fields else replace(ground, fields=plain)
    wanted = wrinkles_in_all(surface, settings, plain)
    half = 1.0 if first is ground else 0.5
    skin, cut = counted(first, settings, wanted, part(progress, 0.0, half))
    if first is not ground:
        skin = grown(ground, skin.radius, settings, part(progress, half, 1.0))
    return skin, cut
