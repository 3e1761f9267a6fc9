"""`rhytid template`: templates to paint over, and masks that change nothing yet."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import (
    MESH_FILES,
    add_json,
    add_mesh,
    add_prim,
    add_several,
    add_unit,
    length_unit,
    prim_clip,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.painted_maps import MOST_TEXELS, NEUTRAL, NEUTRALS, REGION_PREFIX
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.wording import plural
from rhytid.errors import InputError
from rhytid.formats.limits import MOST_SIDE
from rhytid.support.console import counted, detail, make_folder, report, table, working

if TYPE_CHECKING:
    from PIL import Image

    from rhytid.pictures.uv_template import Charts

# Every map that can be painted, and the grey that changes nothing.
MASKS = {**NEUTRALS, "stiffness": NEUTRAL}
LEAST_SIDE = 16
SUMMARY = SUMMARIES["template"]
DETAILS = """
For each UDIM: template.<UDIM>.png, a layer with the wires and borders of charts and arrows that
point up; texel_size.<UDIM>.png, how large texels are on the surface; and a 16-bit grey
NAME.<UDIM>.png of each map, in the grey that leaves skin as it is. guide.png shows the templates
with their legends. Masks that are there already are kept."""


def add_command(commands: Commands) -> None:
    """Add `template` to the parser."""
    example = "rhytid template face.obj --out paint --size 4096"
    parser = new_command(commands, "template", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add_mesh(parser, "MESH", f"{MESH_FILES} of one mesh")
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the images")
    size = f"texels per side of every image, {LEAST_SIDE} to {MOST_SIDE}"
    add("--size", type=int, default=2048, metavar="R", help=size)
    masks = f"masks to write, of {', '.join(MASKS)} (default: all)"
    add_several(parser, "--masks", type=_mask, choices=MASKS, metavar="NAME", help=masks)
    add_unit(parser, "MESH")
    add_prim(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def _mask(name: str) -> str:
    """The name of a mask; that of a region may stand without its prefix."""
    region = REGION_PREFIX + name
    return region if region in MASKS else name


def run(arguments: argparse.Namespace) -> None:
    """Draw templates of all UDIMs, write the masks, and report the files."""
    from rhytid.baking.input_files import mesh_file
    from rhytid.pictures.uv_template import Charts, guide

    size, out = arguments.size, arguments.out
    if not LEAST_SIDE <= size <= MOST_SIDE:
        raise InputError(f"--size {size}: from {LEAST_SIDE} to {MOST_SIDE}")
    read = mesh_file(arguments.mesh, prim_clip(arguments.prim))
    mesh, unit = read.mesh, length_unit(arguments, read)
    udims = mesh_udims(mesh)
    make_folder(out)
    with working("measuring texels"):
        charts = {udim: Charts.of(mesh, udim, size) for udim in udims}
    unit_mm = millimetres(unit) or MILLIMETRES[USUAL_UNIT]
    usual = charts[max(udims, key=lambda udim: len(charts[udim].uv))].usual
    files = []
    for udim in counted(udims, "drawing", "UDIM"):
        files += _templates(out, udim, charts[udim], usual, size)
        files += _masks(out, udim, arguments.masks or list(MASKS), size)
    caption = _caption(arguments.mesh.name, size, usual * unit_mm)
    _write(out / "guide.png", lambda: guide(charts, usual, unit_mm, caption))
    files.append({"file": "guide.png", "shows": "the templates with their legends"})
    facts = {"folder": str(out), "texel_mm": usual * unit_mm, "files": files}
    rows = [(file["file"], file["shows"]) for file in files]
    report(facts, f"{table(('file', 'shows'), rows)}\n{_limit(len(udims), size)}", arguments.json)


def _templates(
    out: Path, udim: int, charts: Charts, usual: float, size: int
) -> list[dict[str, Any]]:
    from rhytid.pictures.uv_template import filled, template

    drawn: dict[str, tuple[Callable[[], Image.Image], str]] = {
        f"template.{udim}.png": (
            lambda: template(charts, size),
            "a layer: wires, borders of charts, arrows that point up",
        ),
        f"texel_size.{udim}.png": (
            lambda: filled(charts, charts.texel_colours(usual), size),
            "red: texels smaller than usual, purple: larger",
        ),
    }
    for name, (draw, _) in drawn.items():
        _write(out / name, draw)
    return [{"file": name, "shows": shows} for name, (_, shows) in drawn.items()]


def _masks(out: Path, udim: int, names: Sequence[str], size: int) -> list[dict[str, Any]]:
    """Write the masks that do not exist yet. Painted ones are never replaced."""
    from rhytid.pictures.uv_template import starter

    files = []
    for name in names:
        file = out / f"{name}.{udim}.png"
        kept = file.exists()
        if not kept:
            _write(file, lambda grey=MASKS[name]: starter(grey, size))  # type: ignore[misc]
        shows = "kept as it is" if kept else f"a mask, grey {MASKS[name]:g}: changes nothing yet"
        files.append({"file": file.name, "shows": shows})
    return files


def _write(file: Path, draw: Callable[[], Image.Image]) -> None:
    from rhytid.support.atomic_files import atomic_write

    with atomic_write(file) as aside:
        draw().save(aside, format="png")
    detail(f"wrote {file.name}")


def _caption(name: str, size: int, usual_mm: float) -> str:
    return (
        f"{name}: at {size} x {size} a texel is {usual_mm:.3g} mm on the surface, the median of "
        "triangles. Where texels are coarse, what is painted is coarse. Paint a few texels beyond "
        "the borders of charts."
    )


def _limit(udims: int, size: int) -> str:
    """A line about how many of these masks fit into one synthesis."""
    most = MOST_TEXELS // (udims * size * size)
    if most >= len(NEUTRALS):
        return "All maps but stiffness go into one synthesis together."
    maps = plural(most, "map, of all UDIMs, goes", "maps, each of all UDIMs, go together")
    return f"At this size {maps} into one synthesis."
