"""`rhytid demo`: the whole service on one face, over HTTP, with pictures and times."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, simplefilter

from rhytid.cli.options import (
    FRAME_FILES,
    MESH_FILES,
    add_caches,
    add_json,
    add_mesh,
    add_query,
    add_several,
    add_stiffness,
    add_strict,
    add_unit,
    cache_clip,
    readable,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_device, local_settings
from rhytid.cli.skin_options import add_skin, skin_controls, skin_maps, skin_settings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import USUAL_UNIT, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.support.console import report, table, write_json
from rhytid.support.temporary_folders import temporary_folder
from rhytid_lab.commands import SUMMARIES, check_client

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid_lab.commands.demo_session import Query, Session

SUMMARY = SUMMARIES["demo"]
DETAILS = """
A server is started on a free loopback port; face and animation go through the Python SDK. Without
a mesh the face is procedural: it raises its brows, frowns, smiles and opens its mouth."""


def add_command(commands: Commands) -> None:
    """Add `demo` to the parser."""
    parser = new_command(commands, "demo", SUMMARY, "rhytid demo --out rhytid-demo")
    parser.description = SUMMARY + DETAILS
    parser.epilog = f"{parser.epilog}, or: rhytid demo animation.npz --sampling smooth"
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("rhytid-demo"),
        metavar="DIR",
        help="folder of what is written; maps and sheets of an earlier run there are removed",
    )
    mesh = f"{MESH_FILES}, which may hold the frames"
    add_mesh(parser, "NEUTRAL", mesh, required=False)
    add_several(parser, "--frames", type=readable, metavar="FILE", help=FRAME_FILES)
    add_caches(parser)
    add_unit(parser, "NEUTRAL")
    add_skin(parser)
    add(
        "--resolution",
        type=int,
        default=AssetSettings().resolution,
        metavar="R",
        help="texels per side, a power of two",
    )
    add_query(parser)
    add_stiffness(parser)
    add_device(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse)


@with_warnings
def run(arguments: argparse.Namespace, warned: RunWarnings) -> None:
    """Serve, send and draw, then print figures and where the files are."""
    if arguments.frames and arguments.mesh is None:
        arguments.usage_error("--frames needs --mesh or NEUTRAL: the neutral face that they deform")
    check_client()
    # Imported here, so that --help does not wait for OpenCL and the web framework.
    from rhytid.api.server.http_server import serving
    from rhytid.support.console import make_folder
    from rhytid_client import RhytidWarning
    from rhytid_lab.commands.demo_face import animation
    from rhytid_lab.commands.demo_session import FIGURES, Session, write_sheets
    from rhytid_lab.server import connected

    clip = cache_clip(arguments)
    face = animation(arguments.mesh, arguments.frames, arguments.shapes, clip)
    arguments.unit = arguments.unit or face.unit
    warned.file(face.file)
    name = arguments.mesh.name if arguments.mesh else "face.npz"
    warned.inputs(face.mesh, name, arguments.unit or USUAL_UNIT, arguments.resolution, face.frames)
    maps = _painted_maps(arguments, face.mesh)
    out: Path = arguments.out
    make_folder(out)
    if arguments.mesh is None:
        face.save(out / "face.npz")
    with temporary_folder("rhytid-demo-") as store:
        service = local_settings(store, arguments.device)
        with serving(service) as url, connected(url) as client, catch_warnings():
            simplefilter("ignore", RhytidWarning)  # the command prints them itself
            query: Query = {"stretch": arguments.stretch, "sampling": arguments.sampling}
            session = Session(client, face, out, query, warned)
            session.build(_settings(arguments), *maps)
            session.send_frames()
            session.draw()
            sheets = write_sheets(session, millimetres(arguments.unit or USUAL_UNIT) or 1.0)
            figures = {**session.figures(), "key_frames": sheets, **warned.all_figures()}
    write_json(figures, out / FIGURES)
    report(figures, _text(figures, session), arguments.json)


def _painted_maps(
    arguments: argparse.Namespace, mesh: Mesh
) -> tuple[Sequence[Path], Mapping[str, Sequence[Path]]]:
    """Files of stiffness, and of maps that guide synthesis by the name of the control."""
    from rhytid.baking.input_files import every_udim

    skin_controls(arguments, mesh)  # what is wrong with them is said before long work
    udims = mesh_udims(mesh)
    controls = {name: every_udim(files, udims) for name, files in skin_maps(arguments).items()}
    return every_udim(arguments.stiffness, udims), controls


def _settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The usual ones, but for what is given."""
    return skin_settings(arguments, {"resolution": arguments.resolution})


def _text(figures: dict[str, Any], session: Session) -> str:
    keys = ("device", "vertices", "triangles", "pores", "wrinkles", "resolution", "frames", "r_max")
    facts = table(("figure", "value"), [(key, figures[key]) for key in keys])
    rows = [
        (k["frame"], f"{k['abs_p90']:.3f}", f"{k['relative_rms']:.3f}", k["sheet"])
        for k in figures["key_frames"]
    ]
    header = ("frame", "|log stretch| p90", "rms binned - redraw", "contact sheet")
    lies = f"Everything lies in {session.out}: redraw/ and binned/ (EXR), sheets, times.json"
    return "\n\n".join([facts, session.watch.table(), table(header, rows), lies])
