"""`rhytid synthesize`: a wrinkle graph for a mesh, as a file."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.graph_output import (
    add_outputs,
    check_outputs,
    open_device,
    whole_file,
    write_outputs,
)
from rhytid.cli.options import (
    add_caches,
    add_mesh,
    add_strict,
    add_unit,
    cache_clip,
    length_unit,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.skin_options import (
    add_settings,
    add_skin,
    check_typed,
    given_settings,
    skin_controls,
    skin_settings,
)
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings, GraphSettings
from rhytid.domain.expressions import expressions_for_lines
from rhytid.domain.graph import GraphOrigin
from rhytid.domain.painted_maps import painted_regions
from rhytid.support.console import check_suffix, make_place, share_bar, working

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.cli.preview import AgedSkin, SheetPlaces
    from rhytid.device.runtime import Device
    from rhytid.domain.expressions import Expressions, Folds
    from rhytid.domain.mesh import Mesh
    from rhytid.synthesis.generate import Synthesis

GRAPH = ".safetensors"


def add_command(commands: Commands) -> None:
    """Add `synthesize` to the parser."""
    parser = new_command(
        commands,
        "synthesize",
        SUMMARIES["synthesize"],
        "rhytid synthesize face.obj --out face.safetensors --preview face.png",
    )
    add_mesh(parser, "MESH")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="GRAPH.safetensors", help="the file to write"
    )
    add_caches(parser)
    add_unit(parser, "MESH")
    add_strict(parser)
    add_outputs(parser)
    ages = (
        "with --preview: grow the skin at each of these ages, too, for the picture of its regions, "
        "FILE.regions.png: those that expressions of known names show or that are painted, else "
        "its flattest places (default: the age of --set, else 35, where regions are known)"
    )
    add_settings(add_skin(parser), ", as for bake: of these graph and unit count")
    parser.add_argument("--ages", nargs="+", type=float, metavar="AGE", help=ages)
    parser.set_defaults(run=run, usage_error=parser.refuse)


@with_warnings
def run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    """Synthesise the graph, write it, and report its figures."""
    if arguments.ages and arguments.preview is None:
        arguments.usage_error("--ages needs --preview FILE.png: ages are drawn in its picture")
    # Imported here, so that --help needs no OpenCL.
    from rhytid.baking.input_files import mesh_file, shape_files
    from rhytid.formats.graphs import graph_pieces
    from rhytid.synthesis.build_size import BuildSize
    from rhytid.synthesis.capacity import check_amount
    from rhytid.synthesis.generate import synthesize
    from rhytid.synthesis.progress import clocked

    given = given_settings(arguments)
    arguments.unit = arguments.unit or given.get("unit")
    settings = grown_settings(skin_settings(arguments, given))
    check_suffix(arguments.out, GRAPH, "the graph")
    ages = _ages(settings, arguments.ages)
    clip = cache_clip(arguments)
    read = mesh_file(arguments.mesh, clip)
    mesh, unit = read.mesh, length_unit(arguments, read)
    arguments.unit = arguments.unit or read.unit
    settings = grown_settings(skin_settings(arguments, given))
    warnings.file(read)
    warnings.inputs(mesh, arguments.mesh.name, unit, AssetSettings().resolution)
    check_outputs(arguments, mesh)
    make_place(arguments.out)
    controls = skin_controls(arguments, mesh)
    expressions = expressions_for_lines(settings.lines, shape_files(arguments.shapes, read, clip))
    device = open_device(arguments)
    out: Path = arguments.out
    folds = (
        None if expressions is None else _folds(device, mesh, expressions, unit, settings.anatomy)
    )
    wrinkles = check_amount(mesh, settings, controls, device.budget.limit, folds)
    warnings.note(str(BuildSize.of(mesh, wrinkles)))
    with share_bar("synthesis") as show:
        clock, seconds = clocked(show)
        grow = partial(synthesize, mesh, device=device, controls=controls, folds=folds, unit=unit)
        made = grow(settings, progress=clock)
    drawn = AssetSettings(unit=unit, graph=settings).with_lengths(made.lengths)
    warnings.lengths(drawn, made.spacing, made.graph.counts()[1])
    lengths = drawn.lengths(made.spacing)
    origin = GraphOrigin.of(mesh, unit, lengths, settings.start, made.graph.origin)
    graph = made.graph.with_origin(origin)
    write = partial(whole_file, out, graph_pieces(graph))
    facts = {"file": str(out), "seconds": seconds, "warnings": warnings.figures()}
    write_outputs(arguments, device, mesh, graph, facts, write)
    if arguments.preview is None:
        return
    if folds is not None:
        _draw_lines(mesh, folds, arguments.preview)
    if arguments.ages or (folds is not None and folds.regions) or painted_regions(controls):
        from rhytid.cli.preview import SheetPlaces

        skins = (_aged(grow, made, settings, replace(settings, age=a), unit) for a in ages)
        with working("placing patches of regions"):
            places = SheetPlaces.of(mesh, folds, controls, unit)
        _draw_regions(device, mesh, places, skins, arguments.preview, warnings)


def _folds(
    device: Device, mesh: Mesh, expressions: Expressions, unit: str, anatomy: str
) -> Folds | None:
    from rhytid.pipeline.folds import measured_folds
    from rhytid.synthesis.workspace import directly

    limit = AssetSettings().response.log_stretch_limit
    with share_bar("folds") as show:
        return measured_folds(device, mesh, expressions, limit, unit, show, directly, anatomy)


def _draw_lines(mesh: Mesh, folds: Folds, preview: Path) -> None:
    """Draw the preferred lines into a picture beside the preview."""
    from rhytid.pictures.preview import fold_picture
    from rhytid.support.atomic_files import atomic_write

    file = preview.with_suffix(".lines.png")
    with working(f"drawing {file.name}"), atomic_write(file) as aside:
        fold_picture(mesh.positions, mesh.faces, folds).save(aside, format="png")


def _draw_regions(
    device: Device,
    mesh: Mesh,
    places: SheetPlaces,
    skins: Iterable[AgedSkin],
    preview: Path,
    warnings: RunWarnings,
) -> None:
    """Draw the picture of regions beside the preview; say so where it shows none, or where not even
    a patch without one fits."""
    from rhytid.cli.preview import write_region_sheet

    file = preview.with_suffix(".regions.png")
    if not places.known:
        shows = "shows its flattest places" if places.views else "is not written: no patch is flat"
        warnings.note(
            "neither painted masks nor expressions of known names show regions of the mesh: "
            f"{file.name} {shows}"
        )
    if places.views:
        write_region_sheet(device, mesh, places, skins, file)


def _aged(
    grow: Callable[..., Synthesis],
    made: Synthesis,
    settings: GraphSettings,
    aged: GraphSettings,
    unit: str,
) -> AgedSkin:
    """The skin at an age: what was made, or grown anew."""
    from rhytid.cli.preview import AgedSkin

    if aged != settings:
        with share_bar(f"synthesis, age {aged.age:g}") as show:
            made = grow(settings=aged, progress=show)
    drawing = AssetSettings(unit=unit, graph=aged).with_lengths(made.lengths)
    return AgedSkin(aged.age, made.graph, drawing, made.distance)


def _ages(settings: GraphSettings, ages: Sequence[float] | None) -> list[float]:
    """The ages that are asked for, checked; else the age of the settings."""
    for age in ages or ():
        check_typed("age", age, "one of --ages")
    return list(ages or [settings.age])


def grown_settings(given: Mapping[str, Any]) -> GraphSettings:
    """Settings of the synthesis, from those of an asset. Raises SettingsError."""
    return AssetSettings.parse(given).for_synthesis().graph
