"""`rhytid controls`: a picture of what each control does to a patch of skin."""

from __future__ import annotations

import argparse
from pathlib import Path

from rhytid.cli.control_samples import NAMES, full_name, samples, title
from rhytid.cli.options import (
    MESH_FILES,
    add_mesh,
    add_prim,
    add_several,
    add_unit,
    length_unit,
    prim_clip,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_device
from rhytid.cli.summaries import SUMMARIES
from rhytid.errors import InputError
from rhytid.support.console import check_suffix, counted, make_place, note

SUMMARY = SUMMARIES["controls"]
DETAILS = """
Skin is grown anew for each value on a piece of the mesh around the patch, without expressions, so
that lines are level. Stiffness and response are shown on skin that is pressed together. Values in
brackets are the usual ones."""


def add_command(commands: Commands) -> None:
    """Add `controls` to the parser."""
    example = "rhytid controls face.obj --out controls.png"
    parser = new_command(commands, "controls", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add_mesh(parser, "MESH", f"{MESH_FILES} of one mesh")
    add("--out", type=Path, required=True, metavar="FILE.png", help="the picture to write")
    only = f"masks and settings to show, of {', '.join(NAMES)} (default: all)"
    add_several(parser, "--only", type=full_name, choices=NAMES, metavar="NAME", help=only)
    patch = (
        "the place of the patch, U and V in UV (1.3 0.5 is in UDIM 1002) or X, Y and Z near the "
        "surface (default: the flattest place)"
    )
    add("--patch", nargs="+", type=float, default=[], metavar="NUMBER", help=patch)
    add_unit(parser, "MESH")
    add_prim(parser)
    add_device(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Draw every control, and write the picture."""
    from rhytid.baking.input_files import mesh_file
    from rhytid.cli.control_skins import ControlSkins
    from rhytid.cli.graph_output import PNG, open_device
    from rhytid.pictures.sheet import control_sheet
    from rhytid.support.atomic_files import atomic_write

    out: Path = arguments.out
    check_suffix(out, PNG, "the picture")
    if len(arguments.patch) not in (0, 2, 3):
        raise InputError(f"--patch has {len(arguments.patch)} numbers: U V or X Y Z")
    read = mesh_file(arguments.mesh, prim_clip(arguments.prim))
    unit = length_unit(arguments, read)
    make_place(out)
    skins = ControlSkins(open_device(arguments), read.mesh, unit, arguments.patch)
    names = [name for name in NAMES if not arguments.only or name in arguments.only]
    shown = {
        title(name): [skins.patch(sample) for sample in samples(name, skins.unit_mm)]
        for name in counted(names, "drawing", "control")
    }
    with atomic_write(out) as aside:
        control_sheet(shown, _caption(arguments.mesh.name)).save(aside, format="png")
    note(f"rhytid: {len(names)} controls in {out}")


def _caption(name: str) -> str:
    from rhytid.cli.control_skins import LIGHT, PRESSED, SIDE_MM

    return (
        f"{name}, each patch {SIDE_MM:g} mm wide on the surface, the same place, true to scale; "
        f"light from the upper left at {LIGHT:g}°. A mask has one grey everywhere; masks that are "
        "not shown, and settings that are not named, have their usual values; brackets are around "
        f"these where they are shown. Pressed skin is {100 * PRESSED:g} % shorter from left to "
        "right."
    )
