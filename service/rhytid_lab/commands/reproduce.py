"""`rhytid reproduce`: the paper's figures, times and claims, remade as a report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import add_json, add_unit, readable
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import USUAL_UNIT, millimetres
from rhytid.support.console import report, share_bar, table, write_json
from rhytid_lab.commands import SUMMARIES

if TYPE_CHECKING:
    from rhytid.device.runtime import Device
    from rhytid_lab.bench.subject import Subject

RESOLUTION = 4096


def add_command(commands: Commands) -> None:
    """Add `reproduce` to the parser."""
    parser = new_command(
        commands,
        "reproduce",
        SUMMARIES["reproduce"],
        "rhytid reproduce --out rhytid-report",
    )
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("rhytid-report"),
        metavar="DIR",
        help="folder of the report",
    )
    add("--mesh", type=readable, metavar="NPZ", help="a neutral mesh with its frames")
    size = "texels per side of the figures and times"
    add("--resolution", type=int, default=RESOLUTION, metavar="R", help=size)
    add_unit(parser, "NPZ")
    add_device(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Draw, time, measure, and write the page."""
    AssetSettings.parse({"resolution": arguments.resolution})
    # Imported here, so that --help needs no OpenCL.
    from rhytid.engine.engine import open_device
    from rhytid.support.console import make_folder
    from rhytid.support.settings import ServiceSettings
    from rhytid_lab.bench.page import page
    from rhytid_lab.bench.report import Report

    out: Path = arguments.out
    make_folder(out)
    device = open_device(ServiceSettings.from_environment(), arguments.device)
    face = _face(device, arguments.mesh)
    unit_mm = millimetres(arguments.unit or USUAL_UNIT) or 1.0
    made = Report(device, face, out, arguments.resolution, unit_mm)
    with share_bar("reproduce") as show:
        made.run(show)
    write_json(made.figures, out / "report.json")
    (out / "index.html").write_text(page(made.figures), encoding="utf-8")
    report(made.figures, _text(made.figures, out), arguments.json)


def _face(device: Device, mesh: Path | None) -> Subject:
    from rhytid_lab.bench.subject import built_in_face, given_face
    from rhytid_lab.commands.demo_face import animation

    if mesh is None:
        return built_in_face(device)
    found = animation(mesh, ())
    names = [place.label for place in found.frames.places]
    frames = (found.frames.read(place) for place in found.frames.places)
    return given_face(device, mesh.stem, found.mesh, dict(zip(names, frames, strict=True)))


def _text(figures: dict[str, Any], out: Path) -> str:
    times = [
        (row["case"], f"{row['seconds']:.4f}", f"{row['map_copies']:.1f}", f"{row['scaled']:.3f}",
         "-" if row["paper"] is None else f"{row['paper']:g}")
        for row in figures["times"]["rows"]
    ]  # fmt: skip
    accuracy = [
        (_bins(row["bins"]), f"{100 * row['error']:.1f}", f"{row['map_copies']:.1f}",
         f"{row['relative_time']:.2f}", f"{row['memory']:g}")
        for row in figures["accuracy"]["rows"]
    ]  # fmt: skip
    return "\n\n".join(
        [
            table(("case", "seconds", "map copies", "s at 16384", "paper s"), times),
            table(("bins", "rms %", "map copies", "time", "bytes per texel"), accuracy),
            f"The page: {out / 'index.html'}",
        ]
    )


def _bins(bins: dict[str, Any]) -> str:
    depth = "factored" if bins["depth_factored"] else "drawn"
    depth += (" tilt" if bins["tilt"] else "") + f" reach {bins['reach']:g}"
    pores = bins["pore_samples"] or bins["samples"]
    sizes = f"N {bins['count']:2}  M {bins['samples']}, {pores}  {bins['bits']:2} bit"
    return f"{sizes}  {bins['merge']:6}  {depth}"
