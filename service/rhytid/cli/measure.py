"""`rhytid measure`: heights and slopes of patches of skin, at rest and under strain."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import (
    FRAME_FILES,
    add_caches,
    add_force,
    add_json,
    add_mesh,
    add_several,
    add_stiffness,
    add_strict,
    add_unit,
    cache_clip,
    map_file,
    positive,
    readable,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import (
    SCAN_FILES,
    add_scan_settings,
    refuse_without_scan,
)
from rhytid.cli.service_options import add_device
from rhytid.cli.skin_options import add_settings, add_skin, refuse_without_effect, skin_request
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.skin import REGIONS
from rhytid.support.console import check_suffix, make_place, report, share_bar, working

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.cli.measure_patches import Heights, Place, Strain
    from rhytid.cli.measure_report import Measured
    from rhytid.formats.meshes import MeshFile

# Texels per side that skin is drawn with: patches are drawn where they lie alone.
RESOLUTION = 8192
SIDE_MM = 8.0
SUMMARY = SUMMARIES["measure"]
DETAILS = """
Of a square on the surface: Sa, Sq, Ssk, Sku, Sz, Sdq and Sdr as ISO 25178 has them, Ra and Rz of
profiles along and across, slopes, and how far heights are alike by direction. Skin is grown as bake
grows it, taken from --graph, or is displacement of --scan; beside these two, --region-mask says
where a --place is. What lies outside of a published band is said below the table."""


def add_command(commands: Commands) -> None:
    """Add `measure` to the parser."""
    example = "rhytid measure face.npz --place cheek --strain 1.25 --plot cheek.png"
    parser = new_command(commands, "measure", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add_mesh(parser, "MESH")
    _add_places(parser.add_argument_group("patches"))
    _add_strain(parser.add_argument_group("strain"))
    skin = add_skin(parser, graph=True)
    add_force(skin)
    add_stiffness(skin)
    add_settings(skin)
    size = "texels per side that skin is drawn with, a power of two"
    skin.add_argument("--resolution", type=int, metavar="R", default=RESOLUTION, help=size)
    scan = parser.add_argument_group("scanned displacement, in place of skin that is grown")
    add_several(scan, "--scan", type=map_file, metavar="MAP", help=SCAN_FILES)
    add_scan_settings(scan)
    add_caches(parser)
    add_unit(parser, "MESH")
    plot = "write heights, slopes and correlation lengths as a picture"
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help=plot)
    add_device(parser)
    add_json(parser)
    add_strict(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse, residual=[])


def _add_places(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    at = "place of a patch: U V in UV (1.3 0.5 is in UDIM 1002) or X Y Z near the surface; repeat"
    add("--patch", nargs="+", type=float, action="append", default=[], metavar="N", help=at)
    place = (
        "patches of regions, which named expressions show or --region-mask has (default without "
        "--patch: the flattest places)"
    )
    add("--place", nargs="+", choices=REGIONS, default=[], metavar="REGION", help=place)
    size = f"side of a patch, millimetres (default: {SIDE_MM:g})"
    add("--size", type=float, default=SIDE_MM, metavar="MM", help=size)
    turn = "direction that is called along: degrees from level, counter-clockwise (default: 0)"
    add("--along", type=float, default=0.0, metavar="DEGREES", help=turn)
    form = "degree of the form that is taken out, 1 for a plane (default: 2)"
    add("--form", type=int, choices=(1, 2), default=2, help=form)
    cutoff = "take out waves longer than this, too, by a Gaussian filter (default: none)"
    add("--cutoff", type=float, metavar="MM", help=cutoff)


def _add_strain(group: argparse._ArgumentGroup) -> None:
    add = group.add_argument
    along = "measure with the mesh this many times as long along, too: 1.25, or 0.8 for pressed"
    add("--strain", type=float, metavar="S", help=along)
    across = "with --strain: and this many times as long across (default: 1)"
    add("--strain-across", type=float, metavar="S", help=across)
    frames = f"measure in a frame, too: {FRAME_FILES}"
    add("--frames", type=readable, metavar="FILE", help=frames)
    number = "which frame of --frames, or of MESH, from 1 (default with --frames: the first)"
    add("--frame", type=positive, metavar="I", help=number)


def run(arguments: argparse.Namespace) -> None:
    """Measure what the arguments ask for, and report it."""
    _refuse_conflicts(arguments)
    if arguments.plot is not None:
        check_suffix(arguments.plot, ".png", "the plot")
        make_place(arguments.plot)
    # Imported here, so that --help needs no OpenCL.
    from rhytid.baking.input_files import mesh_file
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.cli.measure_inputs import (
        folds_of,
        heights_of,
        places_of,
        those_that_fit,
        unit_of,
    )

    with RunWarnings("measure", arguments.strict, arguments.allow) as warnings:
        read = mesh_file(arguments.mesh, cache_clip(arguments))
        warnings.file(read)
        unit = unit_of(arguments, read)
        folds = folds_of(arguments, read, unit)
        places = places_of(arguments, read, unit, warnings, folds)
        with (
            heights_of(arguments, read, unit, warnings, folds) as heights,
            share_bar("measure") as show,
        ):

            def measured(place: Place) -> Measured:
                show(places.index(place) / len(places), place.name)
                return _measured(arguments, read, heights, place)

            found = those_that_fit(places, measured, warnings)
        _report(arguments, found, warnings)
        _draw(arguments, found)


def _refuse_conflicts(arguments: argparse.Namespace) -> None:
    error = arguments.usage_error
    refuse_without_scan(arguments)
    # Where places are asked for, these two say where they are, whatever the skin is.
    given = dict(vars(arguments))
    if arguments.place:
        given |= {"region_mask": [], "shapes": None}
    refuse_without_effect(argparse.Namespace(**given))
    moves = arguments.strain, arguments.frames or arguments.frame
    if all(one is not None for one in moves):
        error("--strain and --frames both say how the mesh is moved: use one")
    if arguments.scan and any(one is not None for one in moves):
        error("a scan is measured at rest: how it would answer to strain is not known")
    for name in ("graph", "settings", "set", "map", "wrinkles", "spacing", "seed", "region"):
        if arguments.scan and getattr(arguments, name):
            error(f"--{name} is of skin that is grown, --scan gives the relief: use one")
    if arguments.strain_across is not None and arguments.strain is None:
        error("--strain-across is beside --strain: give that, too")
    for option in ("strain", "strain_across", "size", "cutoff"):
        value = getattr(arguments, option)
        if value is not None and not 0.0 < value < 1000.0:
            error(f"--{option.replace('_', '-')} {value:g}: above 0")
    for one in arguments.patch:
        if len(one) not in (2, 3):
            error(f"--patch has {len(one)} numbers: U V or X Y Z")


def _measured(
    arguments: argparse.Namespace, read: MeshFile, heights: Heights, place: Place
) -> Measured:
    """A patch at rest, and strained or in a frame where that is asked for."""
    from rhytid.cli.measure_inputs import frame_of
    from rhytid.cli.measure_report import Measured
    from rhytid.meshes.relief import Figures

    rest = heights.at(place, None, place.frame)
    before = Figures.of(rest, arguments.size)
    strain, words = _strain(arguments), ""
    if strain is not None:
        words = f"{strain.along:g} along, {strain.across:g} across"
        moved = heights.at(place, strain.of(read.mesh, place.frame), place.frame)
    elif (positions := frame_of(arguments, read)) is not None:
        words = f"frame {arguments.frame or 1}"
        moved = heights.at(place, positions, None)
    else:
        return Measured(place, before, (rest, None), cutoff=arguments.cutoff)
    after = Figures.of(moved, arguments.size)
    return Measured(place, before, (rest, moved), after, strain, words, arguments.cutoff)


def _strain(arguments: argparse.Namespace) -> Strain | None:
    from rhytid.cli.measure_patches import Strain

    if arguments.strain is None:
        return None
    return Strain(arguments.strain, arguments.strain_across or 1.0)


def _report(arguments: argparse.Namespace, found: list[Measured], warnings: RunWarnings) -> None:
    from rhytid.cli.measure_report import held_together

    graph = {} if arguments.scan else skin_request(arguments).settings.get("graph", {})
    age = float(graph.get("age", AssetSettings().graph.age))
    held = [line for one in found for line in one.held()] + held_together(found, age)
    figures = {
        "file": str(arguments.mesh),
        "relief": "scan" if arguments.scan else "skin",
        "size_mm": arguments.size,
        "form": arguments.form,
        "cutoff_mm": arguments.cutoff,
        "patches": [one.as_json() for one in found],
        "published": [one.as_json() for one in held],
        **warnings.all_figures(),
    }
    text = "\n\n".join([*(one.table() for one in found), "\n".join(one.line() for one in held)])
    report(figures, text, arguments.json)


def _draw(arguments: argparse.Namespace, found: list[Measured]) -> None:
    """Write the plot, if there is to be one."""
    from rhytid.meshes.relief import ANGLES, EDGES
    from rhytid.pictures.relief_plot import relief_plot
    from rhytid.support.atomic_files import atomic_write

    file: Path | None = arguments.plot
    if file is None:
        return
    caption = (
        f"{arguments.mesh.name}: squares of {arguments.size:g} mm on the surface, along to the "
        "right; greys are heights, the same in a row. Correlation lengths end where heights are "
        "alike to 0.2 only, and lines run where they are longest."
    )
    with working(f"drawing {file.name}"), atomic_write(file) as aside:
        relief_plot([one.shown() for one in found], EDGES, ANGLES, caption).save(aside, "png")
