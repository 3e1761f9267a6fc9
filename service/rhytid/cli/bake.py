"""`rhytid bake`: an animation as sequences of texture files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.frame_range import FrameRange
from rhytid.cli.options import (
    FRAME_FILES,
    MESH_FILES,
    Commands,
    add_caches,
    add_device,
    add_force,
    add_json,
    add_profiles,
    add_query,
    add_several,
    add_stiffness,
    add_strict,
    base_name,
    new_command,
    readable,
)
from rhytid.cli.progress import note
from rhytid.cli.reporting import report
from rhytid.cli.serve import chosen
from rhytid.cli.skin_options import (
    refuse_without_effect,
    skin_options,
)
from rhytid.cli.timing import Stopwatch
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.wording import plural
from rhytid.engine.messages import METHODS, MapQuery
from rhytid.settings import ServiceSettings
from rhytid.unfinished import temporary_folder

if TYPE_CHECKING:
    from rhytid.cli.bake_output import BakeSize
    from rhytid.cli.baking import Baker
    from rhytid.cli.warned import Warned

# Options that say how an asset is built.
_BUILDING = (
    "graph", "spacing", "wrinkles", "seed", "lines", "region", "set", "map", "region_mask", "unit",
    "resolution", "settings", "stiffness", "shapes", "force",
)  # fmt: skip
SUMMARY = "Write the displacement of an animation as textures; continues where it was interrupted."
DETAILS = """
Files are called NAME.<UDIM>.<FRAME>.exr, those of other profiles than float and half otherwise:
docs/textures.md has all names. FRAME is the number that a geometry cache gives; else, where each
frame file holds one frame, the number at the end of its name, or its name where not all have a
number; else frames are counted from 0001.
Maps that were baked from the same inputs are skipped. With --method binned the range of the
precomputed maps comes from the frame that stretches most, unless the settings give bins.r_max.
--frame-range bakes a part: several commands may bake parts into one DIR at once. Where frames have
names and no numbers, they count from 1."""


def add_command(commands: Commands) -> None:
    """Add `bake` to the parser."""
    example = "rhytid bake --mesh face.obj --frames shot/*.obj --out maps"
    skin = skin_options("NEUTRAL", graph=True)
    parser = new_command(commands, "bake", SUMMARY, example, skin)
    parser.description = SUMMARY + DETAILS
    parser.epilog = f"{parser.epilog}, or with: --method convolved --sampling smooth"
    add = parser.add_argument
    add("--mesh", type=readable, required=True, metavar="NEUTRAL", help=MESH_FILES)
    frames = f"{FRAME_FILES}; not needed where NEUTRAL holds frames"
    add_several(parser, "--frames", type=readable, metavar="FILE", help=frames)
    add_caches(parser)
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the maps")
    add(
        "--name",
        type=base_name,
        metavar="NAME",
        help="first part of file names (default: NEUTRAL's)",
    )
    size = f"texels per side, a power of two (default: {AssetSettings().resolution})"
    add("--resolution", type=int, metavar="R", help=size)
    add("--method", choices=METHODS, default="redraw", help="how to draw")
    add_query(parser)
    add_force(parser)
    add_stiffness(parser)
    add("--settings", type=readable, metavar="FILE", help="asset settings as JSON")
    add_profiles(parser)
    geometry = "write each frame as a displaced surface, too: NAME.<FRAME>.glb"
    add("--geometry", choices=("glb", "ply"), help=geometry)
    levels = "how many times --geometry cuts each triangle in four, 0 to 8"
    add("--subdivide", type=int, choices=range(9), default=2, metavar="N", help=levels)
    store = "keep the built asset here, or take --asset from here (default: a temporary folder)"
    add("--store", type=Path, metavar="DIR", help=store)
    asset = "use this built asset of --store, with its settings; builds none"
    add("--asset", metavar="ID", help=asset)
    part = "bake these frames alone, by their numbers: 1-10,15,20-30:2 (default: all)"
    add("--frame-range", type=FrameRange.parse, metavar="RANGE", help=part)
    add_device(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.error)


def run(arguments: argparse.Namespace) -> None:
    """Read everything, build the asset, bake, and report the times."""
    refuse_without_effect(arguments)
    _refuse_beside_asset(arguments)
    if arguments.half and arguments.profile:
        arguments.usage_error("--half is --profile half: use one")
    from rhytid.cli.warned import Warned

    with Warned("bake", arguments.strict, arguments.allow) as warned:
        _run(arguments, warned)


def _run(arguments: argparse.Namespace, warned: Warned) -> None:
    # Imported here, so that --help does not wait for OpenCL.
    from rhytid.cli.bake_inputs import BakeInputs
    from rhytid.cli.baking import Baker, build, stored
    from rhytid.engine.engine import Engine

    given = BakeInputs.read(arguments, warned)
    if given.new is not None:
        note(f"rhytid: {given.size(given.new.settings.resolution).text()}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    watch = Stopwatch()
    with _service(arguments) as service, closing(Engine(service)) as engine:
        if given.new is None:
            asset = stored(engine, arguments.asset, given.mesh)
        else:
            with watch.step("build"):
                asset = build(engine, given.new, warned)
        output = given.output(arguments.out)
        query = MapQuery(arguments.method, arguments.stretch, arguments.sampling)
        baker = Baker(
            engine, asset, given.mesh, query, given.frames, output, watch, warned, given.geometry
        )
        if arguments.method == "binned" and not given.range_fixed:
            baker.calibrate()
        baker.run()
    _report(arguments, baker, watch, given.size(asset.settings["resolution"]))


def _refuse_beside_asset(arguments: argparse.Namespace) -> None:
    """End with a usage error where `--asset` is given without `--store`, or with an option that
    says how an asset is built."""
    if arguments.asset is None:
        return
    if arguments.store is None:
        arguments.usage_error("--asset needs --store: the folder that holds it")
    for name in _BUILDING:
        if getattr(arguments, name):
            option = "--" + name.replace("_", "-")
            arguments.usage_error(f"{option} says how to build an asset, --asset is built: use one")


@contextmanager
def _service(arguments: argparse.Namespace) -> Iterator[ServiceSettings]:
    """The settings of the engine; without --store its assets last as long as the command."""
    with temporary_folder("rhytid-") as folder:
        yield chosen(arguments.store or folder, arguments.device)


def _report(arguments: argparse.Namespace, baker: Baker, watch: Stopwatch, size: BakeSize) -> None:
    figures = {
        "asset": baker.asset.id,
        "out": str(arguments.out),
        "written": baker.written,
        "skipped": baker.skipped,
        "bytes_at_most": asdict(size),
        "steps": watch.figures(),
        **baker.warned.all_figures(),
    }
    what = plural(baker.written, "map" if arguments.geometry is None else "file")
    done = f", {baker.skipped} already there" if baker.skipped else ""
    summary = f"{what} written to {arguments.out}{done}"
    report(figures, f"{watch.table()}\n{summary}", arguments.json)
