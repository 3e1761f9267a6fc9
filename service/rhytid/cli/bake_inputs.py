"""What `rhytid bake` reads before it builds anything."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhytid.cli.argument_types import base_name
from rhytid.cli.bake_output import BakeSize, Output
from rhytid.cli.baking import Geometry
from rhytid.cli.frame_files import FrameFiles, FramePlace
from rhytid.cli.frame_range import FrameRange
from rhytid.cli.frames_list import check_sources, read_frames_list
from rhytid.cli.input_files import graph_file, mesh_file, shape_files, stiffness_files
from rhytid.cli.mesh_options import cache_clip
from rhytid.cli.skin_options import skin_controls, skin_settings
from rhytid.cli.warned import Warned
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.settings_changes import settings_unused
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError, SettingsError
from rhytid.exports.textures.profiles import Profile, profiles_of
from rhytid.formats.frame_set import Clip
from rhytid.formats.meshes import MeshFile


@dataclass(frozen=True)
class BakeInputs:
    """What the arguments and the files that they name ask for.

    new: the asset to build; None where a built one is used.  part: the frames to bake, None = all.
    name: first part of the names of files.  range_fixed: whether the settings, or the asset, fix
    the range of the precomputed maps.
    """

    mesh: Mesh
    new: NewAsset | None
    frames: FrameFiles
    part: FrameRange | None
    profiles: tuple[Profile, ...]
    geometry: Geometry | None
    name: str
    range_fixed: bool

    @classmethod
    def read(cls, arguments: argparse.Namespace, warned: Warned) -> BakeInputs:
        """Read everything, and warn of what is doubtful in it. Raises InputError and LimitError
        naming the file."""
        profiles = profiles_of(arguments.profile or (["half"] if arguments.half else ["float"]))
        given = {} if arguments.asset else asset_settings(arguments)
        AssetSettings.parse(given)
        clip = cache_clip(arguments)
        mesh = mesh_file(arguments.mesh, clip)
        warned.notes(mesh.notes)
        files = arguments.frames or _listed(arguments)
        frames, part = FrameFiles(mesh, files, clip), arguments.frame_range
        check_sources(frames.places if part is None else part.select(frames.places))
        new = None
        if arguments.asset is None:
            if mesh.unit is not None:
                given = {"unit": mesh.unit, **given}
            settings = AssetSettings.parse(given)
            name, unit = arguments.mesh.name, settings.length_unit
            warned.inputs(mesh.mesh, name, unit, settings.resolution, frames)
            new = new_asset(arguments, mesh, settings, clip, warned)
        geometry = None
        if arguments.geometry is not None:
            geometry = Geometry(mesh.mesh, arguments.geometry, arguments.subdivide)
        fixed = new is None or "r_max" in given.get("bins", {})
        name = arguments.name or _own_name(arguments.mesh)
        return cls(mesh.mesh, new, frames, part, profiles, geometry, name, fixed)

    def output(self, folder: Path) -> Output:
        """Where the maps go."""
        return Output(folder, self.name, self.profiles, self.part)

    def size(self, resolution: int) -> BakeSize:
        """Bytes that the maps take at most, of so many texels per side."""
        udims, frames = len(mesh_udims(self.mesh)), self.output(Path()).places(self.frames.places)
        return BakeSize.of(self.profiles, resolution, udims, len(frames))


def _listed(arguments: argparse.Namespace) -> list[Path] | list[FramePlace]:
    """What `--frames-list` lists."""
    listing: Path | None = arguments.frames_list
    if listing is None:
        return []
    return read_frames_list(listing, arguments.frames_folder or listing.parent)


def new_asset(
    arguments: argparse.Namespace,
    mesh: MeshFile,
    settings: AssetSettings,
    clip: Clip,
    warned: Warned,
) -> NewAsset:
    """What the arguments and a mesh file ask for; raises InputError naming the file."""
    graph = graph_file(arguments.graph) if arguments.graph else None
    if graph is not None:
        warned.settings(settings_unused(settings))
    return NewAsset(
        mesh.mesh,
        settings.named_after(arguments.mesh.name),
        graph,
        stiffness=stiffness_files(arguments.stiffness, mesh.mesh),
        controls=skin_controls(arguments, mesh.mesh),
        force=arguments.force,
        shapes=shape_files(arguments.shapes, mesh, clip),
    )


def asset_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The settings file with the options over it; raises SettingsError naming what is wrong."""
    given: Any = {}
    if arguments.settings is not None:
        try:
            given = json.loads(arguments.settings.read_bytes())
        except (ValueError, RecursionError) as exc:
            raise SettingsError(f"{arguments.settings} is not JSON: {exc}") from exc
        AssetSettings.parse(given)
    settings: dict[str, Any] = dict(given)
    if arguments.resolution is not None:
        settings["resolution"] = arguments.resolution
    return skin_settings(arguments, settings)


def _own_name(mesh: Path) -> str:
    """NAME where none is given; raises InputError where the mesh's cannot serve."""
    try:
        return base_name(mesh.stem)
    except argparse.ArgumentTypeError as exc:
        raise InputError(f"{exc}; --name gives another") from exc
