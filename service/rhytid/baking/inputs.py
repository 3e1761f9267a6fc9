"""The files of a bake, read and checked before anything is built."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rhytid.baking.frame_names import (
    FramePlace,
    FrameRange,
    check_file_name,
    frame_numbers,
    is_file_name,
)
from rhytid.baking.frames import FrameFiles, check_sources, read_frames_list
from rhytid.baking.input_files import (
    control_files,
    graph_file,
    mask_files,
    mesh_file,
    residual_files,
    scan_files,
    shape_files,
    stiffness_files,
)
from rhytid.baking.map_sources import Geometry
from rhytid.baking.output import BakeSize, Output
from rhytid.baking.request import BakeRequest, SkinRequest
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import unit_after_number
from rhytid.domain.mesh import Mesh
from rhytid.domain.residual import Residual
from rhytid.domain.scan import ScanSettings
from rhytid.domain.settings_changes import settings_unused
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError
from rhytid.exports.textures.profiles import Profile
from rhytid.formats.frame_set import Clip
from rhytid.formats.meshes import MeshFile
from rhytid.meshes.scan_check import ScanCheck, residual_warnings
from rhytid.support.console import working


@dataclass(frozen=True)
class BakeInputs:
    """The contents of the files that a request names.

    new: the asset to build; None where a built one is used.  part: the frames to bake; None for
    all.  name: first part of the names of files.  range_fixed: whether the range of the precomputed
    maps is given, by the settings or by the built asset.
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
    def read(cls, request: BakeRequest, warnings: RunWarnings) -> BakeInputs:
        """Read and check all files, and print warnings. Raises InputError, LimitError and
        SettingsError naming the file or the setting."""
        skin = request.skin
        given = {} if skin is None else dict(skin.settings)
        AssetSettings.parse(given)
        mesh = mesh_file(request.mesh, request.clip)
        warnings.file(mesh)
        frames, part = FrameFiles(mesh, _files(request), request.clip), request.part
        places = frames.places if part is None else part.select(frames.places)
        check_sources(places)
        new = None
        if skin is not None:
            frames.read(places[0])  # of another mesh? Said now, not after minutes of building
            if mesh.unit is not None:
                given = {"unit": mesh.unit, **given}
            given, scanned = scanned_skin(skin, mesh, given, warnings)
            settings = AssetSettings.parse(given)
            name, unit = request.mesh.name, settings.length_unit
            warnings.inputs(mesh.mesh, name, unit, settings.resolution, frames)
            new = new_asset(skin, mesh, settings.named_after(name), request.clip, warnings)
            new = with_scan(new, scanned)
        geometry = None
        if request.geometry is not None:
            geometry = Geometry(mesh.mesh, request.geometry, request.subdivide)
        fixed = new is None or "r_max" in given.get("bins", {})
        name = request.name or _own_name(request.mesh, warnings)
        return cls(mesh.mesh, new, frames, part, request.profiles, geometry, name, fixed)

    @property
    def numbers(self) -> FrameRange:
        """The numbers of the frames to bake."""
        return self.part or FrameRange.of(frame_numbers(self.frames.places))

    def output(self, folder: Path) -> Output:
        """The files of the maps, in a folder."""
        return Output(folder, self.name, self.profiles, self.part)

    def size(self, resolution: int) -> BakeSize:
        """The largest size of the maps, at `resolution` texels per side."""
        udims, frames = len(mesh_udims(self.mesh)), self.output(Path()).places(self.frames.places)
        return BakeSize.of(self.profiles, resolution, udims, len(frames))


def new_asset(
    skin: SkinRequest,
    mesh: MeshFile,
    settings: AssetSettings,
    clip: Clip,
    warnings: RunWarnings,
) -> NewAsset:
    """The asset that a request asks for on a mesh.  settings: those of the request, parsed. Raises
    InputError naming the file."""
    graph = graph_file(skin.graph) if skin.graph else None
    if graph is not None or (skin.scan and not skin.scan_settings.fill):
        warnings.settings(settings_unused(settings))
    return NewAsset(
        mesh.mesh,
        settings,
        graph,
        stiffness=stiffness_files(skin.stiffness, mesh.mesh),
        controls=control_files(skin.maps, mesh.mesh),
        force=skin.force,
        shapes=shape_files(skin.shapes, mesh, clip),
    )


def scanned_skin(
    skin: SkinRequest, mesh: MeshFile, given: dict[str, Any], warnings: RunWarnings
) -> tuple[dict[str, Any], Residual | ScanCheck | None]:
    """The settings of the asset, as JSON, and its scan, or the residual of its graph. What is
    probably wrong with a scan is printed."""
    if skin.residual:
        residual = residual_files(skin.residual, mesh.mesh)
        if "unit" in given:  # else that of the graph, which is read later
            warnings.add(residual_warnings(residual, given["unit"]))
            warnings.refuse()
        side = len(next(iter(residual.codes.values())))
        shape = {"grain": 0.0, "undulation": 0.0, **given.get("shape", {})}
        return {"resolution": side, **given, "shape": shape}, residual
    if not skin.scan:
        return given, None
    unit = AssetSettings.parse(given).length_unit
    how = skin.scan_settings
    check = measured_scan(skin.scan, mesh.mesh, how, unit, warnings, skin.scan_masks)
    warnings.refuse()
    return {"resolution": check.resolution(), **given}, check


def measured_scan(
    files: Sequence[Path],
    mesh: Mesh,
    settings: ScanSettings,
    unit: str,
    warnings: RunWarnings,
    masks: Sequence[Path] = (),
) -> ScanCheck:
    """Displacement measured on its mesh; what is probably wrong is added to `warnings`.

    unit: of the mesh.  masks: images of where it counts. Raises InputError and SettingsError naming
    the file or the setting.
    """
    scan = scan_files(files, mesh, settings, unit)
    if settings.scale is None:  # codes need one
        length = f"1 {unit_after_number(settings.unit or unit)}"
        warnings.note(f"without --scale the value 1 of these floats is taken for {length}")
    found = ScanCheck(scan, mesh, unit, settings, mask_files(masks, mesh))
    with working("measuring the scan"):
        warnings.add(found.warnings())
    return found


def with_scan(new: NewAsset, scanned: Residual | ScanCheck | None) -> NewAsset:
    """The asset with its residual, or with the scan to be traced."""
    if isinstance(scanned, ScanCheck):
        with working("resampling the scan"):
            return replace(new, scan=scanned.relief(new.settings.resolution))
    return replace(new, residual=scanned)


def _files(request: BakeRequest) -> Sequence[Path] | Sequence[FramePlace]:
    """Files of frames, or the frames that a list names; empty where the request has neither."""
    listing = request.frames_list
    if request.frames or listing is None:
        return request.frames
    return read_frames_list(listing, request.frames_folder or listing.parent)


def _own_name(mesh: Path, warnings: RunWarnings) -> str:
    """The name of the mesh file as first part of the names of files, with `_` for what they cannot
    have; raises InputError where nothing is left."""
    if is_file_name(mesh.stem):
        return mesh.stem
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", mesh.stem).strip("_")[:64]
    try:
        check_file_name(name)
    except InputError as error:
        raise InputError(f"{mesh.name}: {error}; --name gives another") from error
    warnings.note(f"maps are called {name}: their names have no blanks or dots; --name")
    return name
