"""`rhytid export`: a skin package, which holds all that the fast method reads at run time."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import (
    MESH_FILES,
    add_caches,
    add_force,
    add_json,
    add_strict,
    add_unit,
    cache_clip,
    readable,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import add_scan, options_named, refuse_scan_conflicts
from rhytid.cli.service_options import add_device, local_settings
from rhytid.cli.skin_options import add_settings, add_skin, refuse_without_effect, skin_request
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import NotFoundError
from rhytid.support.console import counted, make_folder, report, table, working
from rhytid.support.temporary_folders import temporary_folder

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.domain.expressions import Expressions
    from rhytid.domain.mesh import Mesh
    from rhytid.engine.engine import Engine
    from rhytid.engine.messages import NewAsset
    from rhytid.exports.skin_package.package import PackageWriter
    from rhytid.formats.frame_set import Clip

SUMMARY = SUMMARIES["export"]
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
    "map", "region_mask", "unit", "force", "scan", "residual",
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
    add_settings(parser)
    add_force(add_skin(parser, graph=True))
    add_scan(parser.add_argument_group("scanned displacement"))
    levels = "levels of the maps: 1 for the finest alone (default: down to one texel)"
    add("--levels", type=int, choices=range(1, 16), metavar="N", help=levels)
    store = "folder of the assets (default: with --asset of RHYTID_STORE, else a temporary one)"
    add("--store", type=Path, metavar="DIR", help=store)
    add_device(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse, stiffness=[])


def run(arguments: argparse.Namespace) -> None:
    """Take or build the asset, write the package, and report its figures."""
    if arguments.asset is not None:
        for name in _BUILDING:
            given = getattr(arguments, name)
            if given is not None and given is not False and given != []:
                option = "--" + name.replace("_", "-")
                arguments.usage_error(f"{option} says how an asset is built, --asset names one")
    else:
        refuse_scan_conflicts(arguments)
        # Shapes are morph targets here, whatever lines grow by.
        refuse_without_effect(argparse.Namespace(**{**vars(arguments), "shapes": None}))
    from rhytid.baking.run_warnings import RunWarnings

    with RunWarnings("export", arguments.strict, arguments.allow) as warnings, options_named():
        _run(arguments, warnings)


def _run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    # Imported here, so that --help does not wait for OpenCL.
    from rhytid.baking.assets import naming_store
    from rhytid.exports.skin_package.maps import SkinMaps
    from rhytid.exports.skin_package.package import PackageWriter, has_package

    has_package(arguments.folder)  # raises where it is in the way, before long work
    clip = cache_clip(arguments)
    new = None if arguments.mesh is None else _NewSkin.read(arguments, clip, warnings)
    if new is not None:
        make_folder(arguments.folder)
    with _engine(arguments) as engine:
        with naming_store(local_settings(arguments.store, None).store):
            skin = _stored(engine, arguments, clip) if new is None else new.built(engine, warnings)
        make_folder(arguments.folder)
        with working("reading the asset"):
            maps = SkinMaps.of(engine, skin.asset)
        writer = PackageWriter(maps, skin.mesh, skin.shapes, arguments.folder, arguments.levels)
        for step in counted(writer.steps(), "exporting", "part"):
            step()
    _report(arguments, skin, writer, warnings)


@dataclass(frozen=True, eq=False)
class _Skin:
    """The skin of a package.

    asset: id of a ready asset.  shapes: become morph targets.
    """

    asset: str
    mesh: Mesh
    shapes: Expressions | None


@dataclass(frozen=True, eq=False)
class _NewSkin:
    """An asset that is built for the package.

    shapes: become morph targets.  calibrated: whether the settings give the range of the maps.
    """

    new: NewAsset
    shapes: Expressions | None
    calibrated: bool

    @classmethod
    def read(cls, arguments: argparse.Namespace, clip: Clip, warnings: RunWarnings) -> _NewSkin:
        """Read and check all files, and print warnings. Raises InputError, LimitError and
        SettingsError naming the file or the setting."""
        from rhytid.baking.input_files import mesh_file
        from rhytid.baking.inputs import new_asset, scanned_skin, with_scan
        from rhytid.exports.skin_package.maps import check_settings

        skin = skin_request(arguments)
        side = {} if skin.residual else {"resolution": RESOLUTION}  # which a residual has
        given = {**side, **skin.settings}
        mesh = mesh_file(arguments.mesh, clip)
        if mesh.unit is not None and "unit" not in given:
            given["unit"] = mesh.unit
        given, scanned = scanned_skin(skin, mesh, given, warnings)
        settings, name = AssetSettings.parse(given), arguments.mesh.name
        check_settings(settings)
        warnings.file(mesh)
        warnings.inputs(mesh.mesh, name, settings.length_unit, settings.resolution)
        new = new_asset(skin, mesh, settings.named_after(name), clip, warnings)
        shapes = mesh.shapes if arguments.shapes is None else new.shapes
        if new.graph is not None:  # its lines are grown
            new = replace(new, shapes=None)
        return cls(with_scan(new, scanned), shapes, "r_max" in given.get("bins", {}))

    def built(self, engine: Engine, warnings: RunWarnings) -> _Skin:
        """Build the asset. The range of its maps fits the shape that stretches most."""
        from rhytid.baking.assets import build, finish

        asset = build(engine, self.new, warnings)
        if self.shapes is not None and len(self.shapes) and not self.calibrated:
            positions = counted([*self.shapes.positions], "measuring", "shape")
            stretched = [engine.frames.put(asset.id, "shape", p) for p in positions]
            engine.frames.delete(asset.id, "shape")
            sizes = [info.log_stretch["abs_p90"] for info in stretched]
            most = self.shapes.positions[sizes.index(max(sizes))]
            finish(engine, engine.assets.calibrate(asset.id, most), "bins")
        return _Skin(asset.id, self.new.mesh, self.shapes)


def _stored(engine: Engine, arguments: argparse.Namespace, clip: Clip) -> _Skin:
    """A built asset of the store, with the shapes of `--shapes`, else with those that came with its
    mesh. Raises NotFoundError and NotReadyError."""
    from rhytid.baking.input_files import shape_files
    from rhytid.formats.meshes import MeshFile

    asset = arguments.asset
    mesh = engine.assets.mesh(asset)
    shapes = shape_files(arguments.shapes, MeshFile(mesh), clip)
    if arguments.shapes is None:
        with suppress(NotFoundError):  # none came
            shapes = engine.assets.shapes(asset)
    return _Skin(asset, mesh, shapes)


@contextmanager
def _engine(arguments: argparse.Namespace) -> Iterator[Engine]:
    """An engine on the store that is named. Without one, a new asset lasts as long as the
    command."""
    from rhytid.cli.snapshot import opened
    from rhytid.engine.engine import Engine

    with temporary_folder("rhytid-") as folder:
        store = arguments.store
        if arguments.asset is not None:
            with opened(store, new=False):  # raises where there is none
                pass
        elif store is None:
            store = folder
        with closing(Engine(local_settings(store, arguments.device))) as engine:
            yield engine


def _report(
    arguments: argparse.Namespace, skin: _Skin, writer: PackageWriter, warnings: RunWarnings
) -> None:
    manifest, files = writer.manifest, writer.files
    assert manifest is not None
    figures = {
        "asset": skin.asset,
        "out": str(arguments.folder),
        "files": len(files),
        "bytes": sum(file.stat().st_size for file in files),
        "texture_bytes": manifest.texture_bytes,
        "texture_bytes_of_level_0": manifest.texture_bytes_of_level_0,
        "shapes": len(manifest.mesh.shapes),
        "r_max": manifest.blend.r_max,
    }
    text = table(("figure", "value"), figures.items())
    report({**figures, **warnings.all_figures()}, text, arguments.json)
