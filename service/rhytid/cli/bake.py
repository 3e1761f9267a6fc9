"""`rhytid bake`: an animation as sequences of texture files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.baking.request import CHUNK, LOCAL, USUAL_SECONDS, BakeRequest
from rhytid.cli.options import (
    FRAME_FILES,
    Arguments,
    add_caches,
    add_force,
    add_json,
    add_mesh,
    add_profiles,
    add_progress,
    add_query,
    add_several,
    add_shine,
    add_stiffness,
    add_strict,
    add_unit,
    base_name,
    cache_clip,
    frame_range,
    positive,
    readable,
    seconds,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import add_scan, options_named, refuse_scan_conflicts
from rhytid.cli.service_options import add_device, add_shared_store, service_settings
from rhytid.cli.skin_options import add_settings, add_skin, refuse_without_effect, skin_request
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.methods import METHODS
from rhytid.engine.messages import MapQuery
from rhytid.exports.textures import COMPRESSIONS, USUAL, Shine
from rhytid.support.build_identity import check_drawing
from rhytid.support.console import check_suffix, make_place, note, report, working

if TYPE_CHECKING:
    from rhytid.baking.baker import Baker

# Options that say how an asset is built.
_BUILDING = (
    "graph", "spacing", "wrinkles", "seed", "lines", "region", "set", "map", "region_mask", "unit",
    "settings", "stiffness", "shapes", "force", "residual", "scan",
)  # fmt: skip
# Of a picture of a frame, per side.
_PIXELS = 1600
SUMMARY = SUMMARIES["bake"]
DETAILS = """
Files are called NAME.<UDIM>.<FRAME>.exr, those of other profiles than float and half otherwise:
docs/textures.md has all names. FRAME is the number that a geometry cache gives; else, where each
frame file holds one frame, the number at the end of its name, or its name where not all have a
number; else frames are counted from 0001.
Maps that were baked from the same inputs are skipped. With --scan the displacement is checked as
by `check`, traced as by `trace`, and moves; nothing is to be added to the maps. With --method
binned the range of the precomputed maps comes from the frame that stretches most, unless the
settings give bins.r_max. --frame-range bakes a part: several commands may bake parts into one DIR
at once. Where frames have names and no numbers, they count from 1."""


def add_command(commands: Commands) -> None:
    """Add `bake` to the parser."""
    example = "rhytid bake face.obj --frames shot/*.obj --out maps"
    parser = new_command(commands, "bake", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    parser.epilog = f"{parser.epilog}, or with: --method convolved --sampling smooth"
    _add_input(parser.add_argument_group("input"))
    skin = add_skin(parser, graph=True)
    add_force(skin)
    add_stiffness(skin)
    add_settings(skin)
    add_scan(parser.add_argument_group("scanned displacement"))
    _add_output(parser.add_argument_group("output"))
    _add_machines(parser.add_argument_group("assets, devices and many machines"))
    reports = parser.add_argument_group("what is reported")
    add_strict(reports)
    add_json(reports)
    add_progress(reports)
    parser.set_defaults(run=run, usage_error=parser.refuse)


def _add_input(group: Arguments) -> None:
    """Add the options of the mesh and its frames."""
    add = group.add_argument
    add_mesh(group, "NEUTRAL")
    frames = f"{FRAME_FILES}; not needed where NEUTRAL holds frames"
    add_several(group, "--frames", type=readable, metavar="FILE", help=frames)
    listed = "a text file that lists files of frames, or frames, in place of --frames"
    add("--frames-list", type=readable, metavar="FILE", help=listed)
    beside = "folder that the names in --frames-list are relative to (default: its own folder)"
    add("--frames-folder", type=Path, metavar="DIR", help=beside)
    part = "bake these frames alone, by their numbers: 1-10,15,20-30:2 (default: all)"
    add("--frame-range", type=frame_range, metavar="RANGE", help=part)
    add_caches(group)
    add_unit(group, "NEUTRAL")


def _add_output(group: Arguments) -> None:
    """Add the options of what is drawn and written."""
    add = group.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the maps")
    picture = "draw the first frame, the whole mesh as it is seen from +z, into a picture, too"
    add("--picture", type=Path, metavar="FILE.png", help=picture)
    name = "first part of file names (default: NEUTRAL's)"
    add("--name", type=base_name, metavar="NAME", help=name)
    size = f"texels per side, a power of two (default: {AssetSettings().resolution})"
    add("--resolution", type=int, metavar="R", help=size)
    add("--method", choices=METHODS, default="redraw", help="how to draw")
    add_query(group)
    add_profiles(group)
    lag = (
        "seconds after which blood has followed the area of skin by 63 percent, at --fps frames "
        f"per second; of --profile blood (default: {USUAL_SECONDS})"
    )
    add("--blood-time", type=seconds, metavar="S", help=lag)
    add_shine(group)
    geometry = "write each frame as a displaced surface, too: NAME.<FRAME>.glb"
    add("--geometry", choices=("glb", "ply"), help=geometry)
    levels = "how many times --geometry cuts each triangle in four, 0 to 8"
    add("--subdivide", type=int, choices=range(9), default=2, metavar="N", help=levels)


def _add_machines(group: Arguments) -> None:
    """Add the options of stores, devices and many machines."""
    add = group.add_argument
    store = "keep the built asset here, or take --asset from here (default: a temporary folder)"
    add("--store", type=Path, metavar="DIR", help=store)
    add_shared_store(group)
    asset = "use this built asset of --store, or of --shared-store, with its settings; builds none"
    add("--asset", metavar="ID", help=asset)
    add_device(group)
    bundle = "write a job of a render farm into DIR (Open Job Description); bakes no map"
    add("--openjd", type=Path, metavar="DIR", help=bundle)
    chunk = (
        f"frames per task of --openjd (default: {CHUNK}) or --dask (default: such that each worker "
        "gets four tasks, 50 at most)"
    )
    add("--chunk", type=positive, metavar="N", help=chunk)
    drawing = "fail where this rhytid draws otherwise: what `rhytid --version` calls drawing"
    add("--drawing-version", metavar="VERSION", help=drawing)
    _add_dask(group)


def _add_dask(group: Arguments) -> None:
    """Add `--dask` and `--dask-workers`."""
    add = group.add_argument
    where = (
        f"bake on the workers of the Dask scheduler at this address, or of processes here: {LOCAL}"
    )
    add("--dask", metavar="ADDRESS", help=where)
    workers = (
        f"processes of --dask {LOCAL} (default: one for each GPU; 2 without, or on a named device)"
    )
    add("--dask-workers", type=positive, metavar="N", help=workers)


def run(arguments: argparse.Namespace) -> None:
    """Bake what the arguments ask for, and report the result."""
    _refuse_conflicts(arguments)
    if arguments.drawing_version:
        check_drawing(arguments.drawing_version)
    # Imported here, so that --help does not wait for OpenCL.
    from rhytid.baking.bake import bake
    from rhytid.baking.run_warnings import RunWarnings

    if arguments.picture is not None:
        check_suffix(arguments.picture, ".png", "the picture")
        make_place(arguments.picture)
    with RunWarnings("bake", arguments.strict, arguments.allow) as warnings, options_named():
        with bake(_request(arguments), warnings) as (summary, baker):
            _draw(arguments.picture, baker)
        report(summary.figures, summary.text, arguments.json)


def _draw(file: Path | None, baker: Baker) -> None:
    """Draw the first frame into a file, if there is one."""
    if file is None:
        return
    from PIL import Image

    from rhytid.pictures.surface_patch import whole_picture
    from rhytid.support.atomic_files import atomic_write

    positions, maps = baker.first_maps()
    with working(f"drawing {file.name}"), atomic_write(file) as aside:
        picture = whole_picture(baker.mesh, positions, maps, _PIXELS)
        Image.fromarray(picture).save(aside, format="png")


def _request(arguments: argparse.Namespace) -> BakeRequest:
    """The request that the arguments make. Raises InputError and SettingsError naming what is
    wrong."""
    from rhytid.exports.textures.profiles import profiles_of

    names = arguments.profile or (["half"] if arguments.half else ["float"])
    how = Shine(arguments.level, arguments.base_roughness)
    profiles = profiles_of(names, arguments.compression, how)
    return BakeRequest(
        mesh=arguments.mesh,
        out=arguments.out,
        profiles=profiles,
        compression=arguments.compression,
        query=MapQuery(arguments.method, arguments.stretch, arguments.sampling),
        service=service_settings(arguments.store, arguments.device, arguments.shared_store),
        skin=skin_request(arguments) if arguments.asset is None else None,
        asset=arguments.asset,
        resolution=arguments.resolution,
        store=arguments.store,
        clip=cache_clip(arguments),
        frames=arguments.frames,
        frames_list=arguments.frames_list,
        frames_folder=arguments.frames_folder,
        part=arguments.frame_range,
        name=arguments.name,
        geometry=arguments.geometry,
        subdivide=arguments.subdivide,
        openjd=arguments.openjd,
        dask=arguments.dask,
        dask_workers=arguments.dask_workers,
        chunk=arguments.chunk,
        blood_seconds=USUAL_SECONDS if arguments.blood_time is None else arguments.blood_time,
        shine=how,
        strict=arguments.strict,
        allow=arguments.allow,
    )


def _refuse_conflicts(arguments: argparse.Namespace) -> None:
    """End with a usage error where options exclude each other, or where one has no effect."""
    refuse_without_effect(arguments)
    refuse_scan_conflicts(arguments)
    _refuse_beside_asset(arguments)
    _refuse_dask_conflicts(arguments)
    if arguments.half and arguments.profile:
        arguments.usage_error("--half is --profile half: use one")
    if arguments.compression != COMPRESSIONS[0] and not (
        set(arguments.profile or ["float"]) & {"float", "half"}
    ):
        arguments.usage_error("--compression is of the profiles float and half: use one")
    if arguments.blood_time is not None and "blood" not in arguments.profile:
        arguments.usage_error("--blood-time is of --profile blood: give that, too")
    _refuse_shine_without_effect(arguments)
    if arguments.frames and arguments.frames_list:
        arguments.usage_error("--frames and --frames-list both say which frames: use one")
    if arguments.chunk and arguments.openjd is None and arguments.dask is None:
        arguments.usage_error("--chunk says how many frames a task has: give --openjd or --dask")
    if arguments.picture and arguments.openjd:
        arguments.usage_error("--picture is of a frame that is baked, --openjd bakes none: use one")
    if arguments.frames_folder and not arguments.frames_list:
        arguments.usage_error("--frames-folder is where the files of --frames-list are: give both")


def _refuse_shine_without_effect(arguments: argparse.Namespace) -> None:
    """End with a usage error where `--level` or `--base-roughness` says nothing; print a note where
    maps that belong together would have two levels."""
    of_base = {"roughness", "anisotropy"}
    of_level = of_base | {"slopes", "normal-gl", "normal-dx"}
    names = set(arguments.profile or [])
    if arguments.level is not None and not names & of_level:
        arguments.usage_error(f"--level is of the profiles {', '.join(sorted(of_level))}: use one")
    if arguments.base_roughness != USUAL.roughness and not names & of_base:
        arguments.usage_error("--base-roughness is of the profiles roughness and anisotropy")
    normals = sorted(name for name in names if name.startswith("normal"))
    if arguments.level is None and normals and names & of_base:
        based, told = ", ".join(sorted(names & of_base)), ", ".join(normals)
        note(
            f"rhytid bake: notice: maps of {based} are of level {USUAL.of_moments}, those of "
            f"{told} of level 0: a shader that reads both needs one; give --level"
        )


def _refuse_beside_asset(arguments: argparse.Namespace) -> None:
    """End with a usage error where `--asset` has no store, or stands beside an option of how an
    asset is built."""
    if arguments.asset is None:
        return
    shared_store = service_settings(None, None, arguments.shared_store).shared_store
    if arguments.store is None and shared_store is None:
        arguments.usage_error("--asset needs --store or --shared-store: where it is")
    for name in _BUILDING:
        if getattr(arguments, name):
            option = "--" + name.replace("_", "-")
            arguments.usage_error(f"{option} says how to build an asset, --asset is built: use one")


def _refuse_dask_conflicts(arguments: argparse.Namespace) -> None:
    """End with a usage error where the options of `--dask` exclude others, or have no effect."""
    error, address = arguments.usage_error, arguments.dask
    if address is not None and arguments.openjd is not None:
        error("--openjd and --dask are two ways to many machines: use one")
    if arguments.dask_workers and address != LOCAL:
        error(f"--dask-workers says how many processes --dask {LOCAL} starts: give that, too")
    if address is not None and address != LOCAL and "://" not in address:
        error(f"--dask {address}: {LOCAL}, or an address as tcp://HOST:8786")
