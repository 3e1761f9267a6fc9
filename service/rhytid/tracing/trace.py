"""Traces scans: from the relief of each UDIM to a wrinkle graph, and the residual that it does not
draw.

    displacement(frame) = drawn(graph, frame) + residual

At rest this is the scan, since the residual is the scan less the neutral of the graph.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.lengths import usual_spacing
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.support import cancellation
from rhytid.synthesis.progress import Progress, part, silent
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.seams.copies import with_copies
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.workspace import Caller, Workspace, directly
from rhytid.tracing.chains import chains_of, joined, linked
from rhytid.tracing.elements import (
    TracedLines,
    TracedPores,
    graph_arrays,
    lines_of,
    outside_pits,
    pores_of,
    selected,
    together,
)
from rhytid.tracing.fit import STEPS, drawn_neutral, fitted
from rhytid.tracing.measure import NARROW, above_mean
from rhytid.tracing.ridges import (
    APRON,
    LINE_SCALES,
    NARROW_SCALES,
    TILE,
    Limits,
    find_ridges,
    noise_of,
)

Relief = NDArray[np.float32]
# Grain of a scan with detail, in depths, times what its graph says: about half of it and more.
DETAIL_GRAIN = 0.25
# The least curvature of a line times the square of its scale, in depths.
_FAINTEST = 0.015
# Gaps in a line that are closed, texels.
_GAP = 6.0
# How far from charts the search for lines reads, and texels of a side that are filled together.
_REACH, _FILLED = APRON + NARROW, 512
# Copies over seams are looked for as closely as among pores half a spacing, or two texels, apart:
# what is traced is not narrower than texels are, and what reaches very many places is not followed.
_CLOSEST, _TEXELS = 0.5, 2.0
# How much of the work is done when lines are fitted, and when copies are found. Of a head with many
# seams copies take half of the time at 1024², and less of it on larger maps.
_LINES, _SEAMS = 0.6, 0.95


@dataclass(frozen=True, eq=False)
class Trace:
    """What scans were traced to.

    graph: with copies at seams.  residual: (R, R) float32 of each UDIM, mesh units: the scan less
    what the graph draws at rest, there and outside of charts.  left: for each UDIM what was left
    within charts after each step of the fit, as of `Fitted`.  noise: of each UDIM, from texel to
    texel.  charts: `charted` of each UDIM.  grown: whether grown skin fills in.
    """

    graph: WrinkleGraph
    residual: dict[int, Relief]
    left: dict[int, list[float]]
    noise: dict[int, float]
    charts: dict[int, NDArray[np.bool_]]
    grown: bool = False


@dataclass(frozen=True)
class TraceSettings:
    """How scans are traced.

    spacing: of pores, mesh units, which the graph is said to have; None is usual in the unit.
    noise: the least that scans are taken to have from texel to texel, mesh units, as that of
    rounding to codes, which cannot be measured where slopes are gentle.  steps: of the fit.  tile:
    texels of a side that lines are looked for in at a time.
    """

    spacing: float | None = None
    noise: float = 0.0
    steps: int = STEPS
    tile: int = TILE


def trace(
    device: Device,
    mesh: Mesh,
    reliefs: Mapping[int, Relief],
    settings: AssetSettings,
    how: TraceSettings | None = None,
    progress: Progress = silent,
    call: Caller = directly,
    charts: Mapping[int, NDArray[np.bool_]] | None = None,
) -> Trace:
    """Trace the relief of each UDIM.

    reliefs: (R, R) float32 of each UDIM by its number, mesh units, 0 for the smooth surface, with R
    of the settings; row 0 is the top.  settings: resolved. Their shape is what the graph is drawn
    with later, but for grain and undulation, which a scan has of its own.  progress(fraction,
    stage): called often; may raise CancelledError.  call: runs each step of the search in a task of
    the device.  charts: `charted` of each UDIM, where it is known.

    Raises InputError naming the UDIM whose relief has another size or is not finite, or where there
    is none, and MeshError where the mesh has no UV that can carry lines.
    """
    how, drawn = how or TraceSettings(), traced_settings(settings)
    if not reliefs:
        raise InputError("there is no scan to trace")
    for udim, relief in reliefs.items():
        _check(udim, relief, settings.resolution)
    surface = Surface.of(mesh)
    charts = charts or {udim: charted(device, mesh, udim, settings) for udim in reliefs}
    parts, left, noise = [], {}, {}
    for number, (udim, relief) in enumerate(sorted(reliefs.items())):
        each = _LINES / len(reliefs)
        within = part(progress, each * number, each * (number + 1))
        with Workspace(device, call) as work:
            found = _traced(work, device, relief, charts[udim], drawn, how, within)
        lines, pores, left[udim], noise[udim] = found
        parts.append((udim, lines, pores))
    progress(_LINES, "seams")
    graph = _graph(device, mesh, surface, parts, drawn, how, part(progress, _LINES, _SEAMS))
    residual = {}
    for number, (udim, relief) in enumerate(sorted(reliefs.items())):
        progress(_SEAMS + (1.0 - _SEAMS) * number / len(reliefs), "residual")
        residual[udim] = relief - drawn_neutral(device, graph, drawn, udim)
    progress(1.0, "residual")
    return Trace(graph, residual, left, noise, dict(charts))


def traced_settings(
    settings: AssetSettings, detailed: bool = False, filled: bool = False
) -> AssetSettings:
    """The settings with which a traced graph is drawn: these, without grain and undulation, and
    where lines would be straight and even (`curvature` and `taper` of 0, as in the preset `paper`)
    with those that the scan has.

    detailed: with grain, of which the graph says how much of it there is.  filled: with that and
    the undulation of the settings, for grown skin in it.
    """
    shape = settings.shape
    grain, undulation = DETAIL_GRAIN * detailed, 0.0
    if filled:
        grain, undulation = shape.grain, shape.undulation
    curvature, taper = shape.curvature or 1.0, shape.taper or 1.0
    shape = replace(shape, grain=grain, undulation=undulation, curvature=curvature, taper=taper)
    return replace(settings, shape=shape)


def charted(device: Device, mesh: Mesh, udim: int, settings: AssetSettings) -> NDArray[np.bool_]:
    """(R, R) whether the middle of each texel lies in a triangle."""
    found: NDArray[np.bool_] = shown(device, mesh, udim, settings.resolution, 0) < len(mesh.faces)
    return found


def shown(device: Device, mesh: Mesh, udim: int, side: int, padding: int) -> NDArray[np.int32]:
    """(side, side) the triangle of each texel, or of the nearest one within `padding` texels of
    it; the number of triangles for none."""
    with device.task_or_steps():
        triangles = UdimTriangles(device, mesh, udim, side, padding)
        found = triangles.texels(side, 0, 0, side)
        texels = device.read(found, (side, side), np.int32)
        found.release()
        triangles.release()
    return texels


def _check(udim: int, relief: Relief, side: int) -> None:
    if relief.shape != (side, side):
        size = " by ".join(str(s) for s in relief.shape)
        raise InputError(f"the scan of UDIM {udim} has {size} texels: must be {side} by {side}")
    finite = np.isfinite(relief)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        raise InputError(f"the scan of UDIM {udim} is not finite at row {row}, column {column}")


def _traced(
    work: Workspace,
    device: Device,
    relief: Relief,
    inside: NDArray[np.bool_],
    settings: AssetSettings,
    how: TraceSettings,
    progress: Progress,
) -> tuple[TracedLines, TracedPores, list[float], float]:
    """Lines and pores of a UDIM, fitted; what was left after each step; the noise."""
    assert settings.depth is not None
    depth = settings.depth
    noise = max(noise_of(relief, inside), how.noise)
    whole, scales = _filled(relief, inside), LINE_SCALES
    if settings.shape.cushion > 0.0:
        whole, scales = above_mean(work, whole, NARROW), NARROW_SCALES
    limits = Limits(_FAINTEST * depth, noise, line_scales=scales)
    searching = part(progress, 0.0, 0.3)
    points, pits = find_ridges(work, whole, inside, limits, how.tile, searching)
    links = joined(points, linked(points, relief.shape), _GAP)
    pores = pores_of(pits, depth)
    chains = outside_pits(points, chains_of(links), pores)
    lines = lines_of(points, chains, depth, settings.shape)
    fitting = part(progress, 0.3, 1.0)
    found = fitted(work, device, lines, pores, relief, inside, settings, how.steps, fitting)
    return found.lines, found.pores, found.left, noise


def _filled(relief: Relief, inside: NDArray[np.bool_]) -> Relief:
    """The relief, with that of the nearest texel of a chart where one is within _REACH: what a map
    holds beyond its charts is not skin, and the step there no line."""
    found: Relief = relief.copy()
    for at in product(*(range(0, side, _FILLED) for side in relief.shape)):
        cancellation.check()
        around = tuple(slice(max(one - _REACH, 0), one + _FILLED + _REACH) for one in at)
        near = inside[around]
        if near.any() and not near.all():
            nearest = scipy.ndimage.distance_transform_edt(
                ~near, return_distances=False, return_indices=True
            )
            first = (one - part.start for one, part in zip(at, around, strict=True))
            own = tuple(slice(one, one + _FILLED) for one in first)
            tile = tuple(slice(one, one + _FILLED) for one in at)
            found[tile] = relief[around][tuple(n[own] for n in nearest)]
    return found


def _graph(
    device: Device,
    mesh: Mesh,
    surface: Surface,
    parts: list[tuple[int, TracedLines, TracedPores]],
    settings: AssetSettings,
    how: TraceSettings,
    progress: Progress,
) -> WrinkleGraph:
    """The graph of all UDIMs, on the triangles of the mesh, with copies at seams."""
    spacing = how.spacing or usual_spacing(settings.length_unit)
    joint = together(
        [graph_arrays(lines, pores, udim, settings.resolution) for udim, lines, pores in parts]
    )
    located = _located(device, mesh, joint, settings)
    arrays = _on_triangles(joint, located, len(mesh.faces))
    cancellation.check()
    borders = Borders.of(mesh, surface, neighbours(mesh))
    texel = np.median(surface.narrowest[surface.carries]) / settings.resolution
    apart = max(_CLOSEST * spacing / surface.scale, _TEXELS * float(texel))
    arrays = with_copies(arrays, surface, borders, apart, progress)
    lengths = settings.lengths(spacing)
    origin = GraphOrigin.of(mesh, settings.length_unit, lengths, settings.graph.start)
    return WrinkleGraph(**arrays, origin=origin)


def _located(
    device: Device, mesh: Mesh, arrays: dict[str, NDArray[Any]], settings: AssetSettings
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Triangles of nodes and of wrinkles; the number of triangles for none."""
    uv = arrays["node_uv"]
    middle = uv[arrays["edge_nodes"]].mean(axis=1).astype(np.float32)
    with device.task_or_steps():
        nodes, edges = (
            locate_points(device, mesh, at, settings.resolution, max(settings.padding, 2))
            for at in (uv, middle)
        )
    return nodes, edges


def _on_triangles(
    arrays: dict[str, NDArray[Any]],
    located: tuple[NDArray[np.int32], NDArray[np.int32]],
    triangles: int,
) -> dict[str, NDArray[Any]]:
    """The arrays with triangles, without what has none."""
    of_nodes, of_edges = located
    there = of_nodes < triangles
    edge = (of_edges < triangles) & there[arrays["edge_nodes"]].all(axis=1)
    found = selected(arrays, there, edge)
    found["node_triangle"] = of_nodes[there]
    found["edge_triangle"] = of_edges[edge]
    return found
