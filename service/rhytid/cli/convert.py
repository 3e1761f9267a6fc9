"""`rhytid convert`: a mesh and its animation as one npz, from any file that commands read."""

from __future__ import annotations

import argparse
from pathlib import Path

from rhytid.cli.options import (
    FRAME_FILES,
    add_caches,
    add_json,
    add_mesh,
    add_several,
    cache_clip,
    readable,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.frame import counted_frame
from rhytid.domain.wording import plural
from rhytid.support.console import check_suffix, counted, make_place, report

SUMMARY = SUMMARIES["convert"]
DETAILS = """
A server reads OBJ, PLY, glTF, GLB and npz. It reads no USD, whose layers may name other files,
and no animation but that of an npz. The vertices keep their order; shapes are kept by their
names."""


def add_command(commands: Commands) -> None:
    """Add `convert` to the parser."""
    example = "rhytid convert shot.usdc --out shot.npz"
    parser = new_command(commands, "convert", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add_mesh(parser, "MESH")
    frames = f"frames: {FRAME_FILES} (default: those of MESH)"
    add_several(parser, "--frames", type=readable, metavar="FILE", help=frames)
    add_caches(parser)
    add("--out", type=Path, required=True, metavar="FILE.npz", help="the file to write")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Write the mesh with its frames, and report which names the frames have on a server."""
    from rhytid.baking.frames import FrameFiles
    from rhytid.baking.input_files import mesh_file
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.formats.npz import write_mesh_npz
    from rhytid.support.atomic_files import atomic_write

    out: Path = arguments.out
    check_suffix(out, ".npz", "the mesh")
    clip = cache_clip(arguments)
    read = mesh_file(arguments.mesh, clip)
    with RunWarnings("convert", False) as warnings:
        warnings.file(read)
    moves = arguments.frames or read.frames is not None or read.animation is not None
    files = FrameFiles(read, arguments.frames, clip) if moves else None
    places = files.places if files else []
    make_place(out)
    with atomic_write(out) as aside:
        frames = (files.read(place) for place in counted(places, "writing", "frame") if files)
        write_mesh_npz(aside, read.mesh, read.shapes, frames, len(places))
    labels = [place.label for place in places]
    figures = {
        "file": str(out),
        "vertices": len(read.mesh.positions),
        "triangles": len(read.mesh.faces),
        "shapes": 0 if read.shapes is None else len(read.shapes),
        "frames": labels,
        "unit": read.unit,
    }
    report(figures, _summary(out, labels, read.unit), arguments.json)


def _summary(out: Path, labels: list[str], unit: str | None) -> str:
    lines = [f"{out}: {plural(len(labels), 'frame')}"]
    first = counted_frame(0)
    if labels and labels[0] != first:
        lines.append(f"A server counts them from {first}: frame {labels[0]} is {first} there.")
    if unit is not None:
        lines.append(f'The unit is {unit}: send it with the settings {{"unit": "{unit}"}}.')
    return "\n".join(lines)
