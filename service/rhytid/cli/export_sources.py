"""Where `rhytid export` has its asset from."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rhytid.cli.bake_inputs import asset_settings, new_asset
from rhytid.cli.export import RESOLUTION
from rhytid.cli.input_files import mesh_file, shape_files
from rhytid.cli.progress import counted
from rhytid.cli.ready_assets import build, finish
from rhytid.cli.warned import Warned
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import NewAsset
from rhytid.errors import NotFoundError
from rhytid.exports.skin_package.maps import check_settings
from rhytid.formats.frame_set import Clip
from rhytid.formats.meshes import MeshFile

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine


@dataclass(frozen=True, eq=False)
class Exported:
    """The id of a ready asset, its mesh, and the shapes that become morph targets."""

    asset: str
    mesh: Mesh
    shapes: Expressions | None


@dataclass(frozen=True, eq=False)
class NewSource:
    """An asset that is built for the package.  calibrated: whether the settings fix the range of
    the maps."""

    new: NewAsset
    shapes: Expressions | None
    calibrated: bool

    @classmethod
    def read(cls, arguments: argparse.Namespace, clip: Clip, warned: Warned) -> NewSource:
        """Read everything, and warn of what is doubtful in it; raises InputError, LimitError and
        SettingsError naming the file or the setting."""
        given = {"resolution": RESOLUTION, **asset_settings(arguments)}
        mesh = mesh_file(arguments.mesh, clip)
        if mesh.unit is not None and "unit" not in given:
            given["unit"] = mesh.unit
        settings = AssetSettings.parse(given)
        check_settings(settings)
        warned.notes(mesh.notes)
        unit = settings.length_unit
        warned.inputs(mesh.mesh, arguments.mesh.name, unit, settings.resolution)
        new = new_asset(arguments, mesh, settings, clip, warned)
        shapes = mesh.shapes if arguments.shapes is None else new.shapes
        if new.graph is not None:  # its lines are grown
            new = replace(new, shapes=None)
        return cls(new, shapes, "r_max" in given.get("bins", {}))

    def built(self, engine: Engine, warned: Warned) -> Exported:
        """The asset, its maps made for the shape that stretches most."""
        asset = build(engine, self.new, warned)
        if self.shapes is not None and len(self.shapes) and not self.calibrated:
            positions = counted([*self.shapes.positions], "measuring", "shape")
            stretched = [engine.frames.put(asset.id, "shape", p) for p in positions]
            engine.frames.delete(asset.id, "shape")
            sizes = [info.log_stretch["abs_p90"] for info in stretched]
            most = self.shapes.positions[sizes.index(max(sizes))]
            finish(engine, engine.assets.calibrate(asset.id, most), "bins")
        return Exported(asset.id, self.new.mesh, self.shapes)


def stored(engine: Engine, arguments: argparse.Namespace, clip: Clip) -> Exported:
    """A built asset of the store of the engine, with the shapes of `--shapes`, else with the named
    ones that came with its mesh; raises NotFoundError, NotReadyError."""
    asset = arguments.asset
    mesh = engine.assets.mesh(asset)
    shapes = shape_files(arguments.shapes, MeshFile(mesh), clip)
    if arguments.shapes is None:
        with suppress(NotFoundError):  # none came
            shapes = engine.assets.shapes(asset)
    return Exported(asset, mesh, shapes)
