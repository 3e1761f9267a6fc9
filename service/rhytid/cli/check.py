"""`rhytid check`: problems of a mesh and its frames, found before anything is made of them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import (
    FRAME_FILES,
    add_caches,
    add_json,
    add_mesh,
    add_several,
    add_strict,
    add_unit,
    cache_clip,
    length_unit,
    map_file,
    readable,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import (
    SCAN_FILES,
    add_scan_settings,
    checked_scan,
    refuse_without_scan,
)
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.wording import plural
from rhytid.support.console import check_suffix, counted, make_place, report, table, working

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.meshes.check import MeshCheck
    from rhytid.meshes.scan_check import ScanCheck

_PNG = ".png"


def add_command(commands: Commands) -> None:
    """Add `check` to the parser."""
    parser = new_command(
        commands,
        "check",
        SUMMARIES["check"],
        "rhytid check face.obj --frames shot/*.obj --picture face.check.png",
    )
    add = parser.add_argument
    add_mesh(parser, "MESH")
    frames = f"frames to check: {FRAME_FILES} (default: those of MESH)"
    add_several(parser, "--frames", type=readable, metavar="FILE", help=frames)
    add_caches(parser)
    add_unit(parser, "MESH")
    usual = AssetSettings().resolution
    texels = "texels per side that texel sizes are for"
    add("--resolution", type=int, default=usual, metavar="R", help=texels)
    picture = "write a picture of the mesh and its UV, with the problems coloured"
    add("--picture", type=Path, metavar="FILE.png", help=picture)
    scan = parser.add_argument_group("scanned displacement")
    add_several(scan, "--scan", type=map_file, metavar="MAP", help=SCAN_FILES)
    add_scan_settings(scan)
    add_json(parser)
    add_strict(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse)


@with_warnings
def run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    """Check the mesh, and report. With --strict, warnings are an error at the end."""
    refuse_without_scan(arguments)
    _check(arguments, warnings)
    warnings.refuse()


def _check(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    from rhytid.baking.input_files import mesh_file
    from rhytid.meshes.check import HEADER, MeshCheck, rows

    picture: Path | None = arguments.picture
    if picture is not None:
        check_suffix(picture, _PNG, "the picture")
        make_place(picture)
    AssetSettings.parse({"resolution": arguments.resolution})
    read = mesh_file(arguments.mesh, cache_clip(arguments))
    warnings.file(read)
    unit = length_unit(arguments, read)
    with working("checking the mesh"):
        check = MeshCheck.of(read, unit, arguments.resolution)
    figures = check.figures() | _frames(arguments, check, warnings)
    warnings.add_notices(check.notices())
    scan = _scan(arguments, check, warnings)
    figures["scan"] = None if scan is None else scan.figures()
    figures = {"file": str(arguments.mesh), **figures, **warnings.all_figures()}
    if picture is not None:
        with working(f"drawing {picture.name}"):
            _draw(check, arguments.mesh.name, picture)
    listed = [*rows(check, figures), *([] if scan is None else scan.rows())]
    report(figures, table(HEADER, listed), arguments.json)


def _scan(
    arguments: argparse.Namespace, check: MeshCheck, warnings: RunWarnings
) -> ScanCheck | None:
    """Read and check the displacement that is given, and add its warnings."""
    if not arguments.scan:
        return None
    return checked_scan(arguments, arguments.scan, check.mesh, check.unit, warnings)


def _frames(
    arguments: argparse.Namespace, check: MeshCheck, warnings: RunWarnings
) -> dict[str, Any]:
    """Add the warnings of the mesh and of every frame; return the number of frames, for JSON."""
    from dataclasses import replace

    from rhytid.baking.frames import FrameFiles
    from rhytid.domain.mesh_warnings import FrameCheck

    name, mesh = arguments.mesh.name, check.mesh
    found = check.layout.warnings
    warnings.add(replace(warning, where=f"{name}, {warning.where}") for warning in found)
    if not arguments.frames and check.file.frames is None and check.file.animation is None:
        return {"frames": 0}
    files = FrameFiles(check.file, arguments.frames, cache_clip(arguments))
    looked = FrameCheck(mesh, check.unit)
    for place in counted(files.places, "checking", "frame"):
        warnings.add(looked.warnings(files.read(place), f"frame {place.name}"))
    return {"frames": len(files.places)}


def _draw(check: MeshCheck, name: str, picture: Path) -> None:
    from rhytid.pictures.check import check_picture, problems_of
    from rhytid.support.atomic_files import atomic_write

    masks = check.problems() | check.uneven_texels()
    mesh = f"{name}, {plural(len(check.mesh.faces), 'triangle')}"
    caption = (
        f"{mesh}: a square marks the largest triangle of each kind, in space of those in front; "
        "what lies later in the legend is drawn over what comes before. "
        f"Texels at {check.resolution} x {check.resolution}."
    )
    drawn = check_picture(check.mesh, check.layout.udims, problems_of(masks), caption)
    with atomic_write(picture) as aside:
        drawn.save(aside, format="png")
