"""The parts of an upload as a new asset, wherever they are decoded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import PurePath
from typing import Protocol

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import CONTROLS, Stiffness
from rhytid.domain.scan import ScanSettings
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError, LimitError
from rhytid.formats.frames import read_expressions
from rhytid.formats.graphs import read_graph
from rhytid.formats.meshes import read_mesh
from rhytid.formats.painted import read_controls, read_painted, read_stiffness
from rhytid.formats.scans import read_scan


class Sent(Protocol):
    """One part that was sent.  again: those of the same name after it.  start, size: where it is in
    the file of the upload."""

    @property
    def name(self) -> str:
        """Of the part."""

    @property
    def filename(self) -> str | None:
        """Its extension names the format; None for a plain field."""

    @property
    def start(self) -> int:
        """Bytes before it."""

    @property
    def size(self) -> int:
        """Its own bytes."""

    @property
    def data(self) -> bytes:
        """Its content, read anew."""

    @property
    def again(self) -> tuple[Sent, ...]:
        """Parts of the same name."""


Files = Mapping[str, Sent]


def all_files(parts: Files) -> list[Sent]:
    """Every file of every part."""
    return [one for part in parts.values() for one in (part, *part.again)]


def read_asset(
    parts: Files, settings: AssetSettings, scan: ScanSettings, *, force: bool
) -> NewAsset:
    """Decode mesh, graph, images, shapes and scan; raises InputError, or one of its kinds, naming
    the part or the file, and LimitError."""
    with _named(parts["mesh"]) as mesh:
        read = read_mesh(mesh.data, mesh.filename or "")
    images = {name: _images(parts[name]) for name in CONTROLS if name in parts}
    new = NewAsset(
        mesh=read.mesh,
        settings=settings,
        graph=_graph(parts["graph"]) if "graph" in parts else None,
        frames=read.frames,
        stiffness=_stiffness(parts, read.mesh) if "stiffness" in parts else None,
        controls=read_controls(images, mesh_udims(read.mesh)),
        force=force,
        shapes=_shapes(parts["shapes"], read.mesh) if "shapes" in parts else read.expressions,
        unused=read.unused,
        notices=read.notices,
    )
    if "scan" in parts:
        return _scanned(new, parts, scan)
    if "scan_mask" in parts:
        raise InputError("part scan_mask says where part scan counts, but there is no such part")
    return new


def _scanned(new: NewAsset, parts: Files, settings: ScanSettings) -> NewAsset:
    """The asset with a scan, measured, at the resolution of the asset."""
    # Imported here: few uploads have one.
    from rhytid.meshes.scan_check import ScanCheck
    from rhytid.meshes.scans import scan_of

    mesh, unit = new.mesh, new.settings.length_unit
    maps = read_scan(_images(parts["scan"]), mesh_udims(mesh), partial=settings.partial)
    sent = _images(parts["scan_mask"]) if "scan_mask" in parts else []
    masks = read_painted(sent, mesh_udims(mesh), "scan_mask")
    check = ScanCheck(scan_of(maps, settings, mesh, unit), mesh, unit, settings, masks)
    relief = check.relief(new.settings.resolution)
    return replace(new, scan=relief, noted=tuple(check.warnings()))


def _graph(part: Sent) -> WrinkleGraph:
    with _named(part):
        return read_graph(part.data)


def _shapes(part: Sent, mesh: Mesh) -> Expressions:
    name = part.filename or ""
    if not PurePath(name).suffix:
        raise InputError("part shapes has no filename with .npz or .npy: it names the format")
    with _named(part):
        return read_expressions(part.data, name, mesh)


@contextmanager
def _named(part: Sent) -> Iterator[Sent]:
    """Errors over what a part holds begin with its name."""
    try:
        yield part
    except (InputError, LimitError) as error:
        raise type(error)(f"part {part.name}: {error}") from error


def _stiffness(parts: Files, mesh: Mesh) -> Stiffness:
    return read_stiffness(_images(parts["stiffness"]), mesh_udims(mesh))


def _images(first: Sent) -> list[tuple[str, bytes]]:
    """Names and bytes of the images of a repeated part."""
    return [(one.filename or f"part {one.name}", one.data) for one in (first, *first.again)]
