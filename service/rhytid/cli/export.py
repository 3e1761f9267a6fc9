"""`rhytid export`: a skin package, all that the fast method reads at run time."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.argument_types import readable
from rhytid.cli.mesh_options import MESH_FILES, add_caches, add_unit, cache_clip
from rhytid.cli.options import Commands, add_device, add_force, add_json, add_strict, new_command
from rhytid.cli.progress import counted, working
from rhytid.cli.reporting import report, table
from rhytid.cli.serve import chosen
from rhytid.cli.skin_options import add_skin, refuse_without_effect
from rhytid.support.temporary_folders import temporary_folder

if TYPE_CHECKING:
    from rhytid.cli.export_sources import Exported
    from rhytid.cli.warned import Warned
    from rhytid.engine.engine import Engine
    from rhytid.exports.skin_package.package import PackageWriter

SUMMARY = "Write a skin package: mesh, textures and the shader of the fast method, for engines."
DETAILS = """
The package is a folder that a web server can serve as it is: docs/package.md. With --mesh the skin
is grown as by bake, at 2048 texels per side unless the settings say otherwise; where there are
shapes the range of the maps comes from the one that stretches most, unless the settings give
bins.r_max. With --asset a built asset of a store is taken as it is. A folder without manifest.json
holds no whole package."""
RESOLUTION = 2048
# Options that say how an asset is built: with --asset they have no effect.
_BUILDING = (
    "graph", "settings", "resolution", "spacing", "wrinkles", "seed", "lines", "region", "set",
    "map", "region_mask", "unit", "force",
)  # fmt: skip


def add_command(commands: Commands) -> None:
    """Add `export` to the parser."""
    example = "rhytid export package --mesh face.glb"
    parser = new_command(commands, "export", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add(
        "folder", type=Path, metavar="DIR", help="folder of the package; made where it is not there"
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--mesh", type=readable, metavar="NEUTRAL", help=MESH_FILES)
    source.add_argument("--asset", metavar="ID", help="an asset of the store")
    add_caches(parser)
    add_unit(parser, "NEUTRAL")
    size = f"texels per side, a power of two (default: {RESOLUTION})"
    add("--resolution", type=int, metavar="R", help=size)
    add("--settings", type=readable, metavar="FILE", help="asset settings as JSON")
    add_force(add_skin(parser, graph=True))
    levels = "levels of the maps: 1 for the finest alone (default: down to one texel)"
    add("--levels", type=int, choices=range(1, 16), metavar="N", help=levels)
    store = "folder of the assets (default: with --asset of RHYTID_STORE, else a temporary one)"
    add("--store", type=Path, metavar="DIR", help=store)
    add_device(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse, stiffness=[])


def run(arguments: argparse.Namespace) -> None:
    """Take or build the asset, write the package and report its figures."""
    if arguments.asset is not None:
        for name in _BUILDING:
            given = getattr(arguments, name)
            if given is not None and given is not False and given != []:
                option = "--" + name.replace("_", "-")
                arguments.usage_error(f"{option} says how an asset is built, --asset names one")
    elif arguments.graph is not None:
        # Shapes are morph targets here, whatever lines grow by.
        refuse_without_effect(argparse.Namespace(**{**vars(arguments), "shapes": None}))
    from rhytid.cli.warned import Warned

    with Warned("export", arguments.strict, arguments.allow) as warned:
        _run(arguments, warned)


def _run(arguments: argparse.Namespace, warned: Warned) -> None:
    # Imported here, so that --help does not wait for OpenCL.
    from rhytid.cli.export_sources import NewSource, stored
    from rhytid.cli.places import make_folder
    from rhytid.cli.shared_assets import searching
    from rhytid.exports.skin_package.maps import SkinMaps
    from rhytid.exports.skin_package.package import PackageWriter, has_package

    has_package(arguments.folder)  # raises where it is in the way, before long work
    clip = cache_clip(arguments)
    new = None if arguments.mesh is None else NewSource.read(arguments, clip, warned)
    if new is not None:
        make_folder(arguments.folder)
    with _engine(arguments) as engine:
        with searching(chosen(arguments.store, None).store):
            source = stored(engine, arguments, clip) if new is None else new.built(engine, warned)
        make_folder(arguments.folder)
        with working("reading the asset"):
            maps = SkinMaps.of(engine, source.asset)
        writer = PackageWriter(maps, source.mesh, source.shapes, arguments.folder, arguments.levels)
        for step in counted(writer.steps(), "exporting", "part"):
            step()
    _report(arguments, source, writer, warned)


@contextmanager
def _engine(arguments: argparse.Namespace) -> Iterator[Engine]:
    """On the store that is named; for a new asset without one it lasts as long as the command."""
    from rhytid.cli.snapshot import opened
    from rhytid.engine.engine import Engine

    with temporary_folder("rhytid-") as folder:
        store = arguments.store
        if arguments.asset is not None:
            with opened(store, new=False):  # raises where there is none
                pass
        elif store is None:
            store = folder
        with closing(Engine(chosen(store, arguments.device))) as engine:
            yield engine


def _report(
    arguments: argparse.Namespace, source: Exported, writer: PackageWriter, warned: Warned
) -> None:
    manifest, files = writer.manifest, writer.files
    assert manifest is not None
    figures = {
        "asset": source.asset,
        "out": str(arguments.folder),
        "files": len(files),
        "bytes": sum(file.stat().st_size for file in files),
        "texture_bytes": manifest.texture_bytes,
        "texture_bytes_of_level_0": manifest.texture_bytes_of_level_0,
        "shapes": len(manifest.mesh.shapes),
        "r_max": manifest.blend.r_max,
    }
    text = table(("figure", "value"), figures.items())
    report({**figures, **warned.all_figures()}, text, arguments.json)
