"""Reads the files that a command line names. Every error names its file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.frame_names import ANY_UDIM
from rhytid.domain.expressions import Expressions, evenly_spaced
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.domain.painted_maps import Controls, Map, Stiffness
from rhytid.domain.residual import Residual
from rhytid.domain.scan import Scan, ScanSettings
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import InputError, LimitError
from rhytid.formats.caches import (
    check_frame_file,
    check_shape_file,
    is_cache,
    read_cache,
    read_mesh_file,
)
from rhytid.formats.frame_set import Clip, FrameSet
from rhytid.formats.frames import read_expressions, read_frame_file
from rhytid.formats.graphs import read_graph
from rhytid.formats.meshes import MeshFile
from rhytid.formats.painted import read_controls, read_painted, read_stiffness
from rhytid.support.console import working


def mesh_file(file: Path, clip: Clip | None = None) -> MeshFile:
    """Read a neutral mesh, with the frames and shapes that the file holds."""
    with _named(file), working(f"reading {file.name}"):
        found = read_mesh_file(file, clip)
    make = found.animation
    return found if make is None else replace(found, animation=lambda: _named_set(file, make))


def frame_file(file: Path, vertices: int, centre: Centre = ORIGIN) -> NDArray[np.float32]:
    """(N, V, 3) positions of the frames of one file, relative to the centre of their mesh."""
    with _named(file):
        return read_frame_file(file.read_bytes(), file.name, vertices, centre)


def frame_set(
    file: Path, vertices: int, centre: Centre = ORIGIN, clip: Clip | None = None
) -> FrameSet:
    """The frames of one file as a set. Those of a geometry cache are read when they are asked
    for."""
    with _named(file):
        check_frame_file(file)
    if not is_cache(file):
        return FrameSet.of(frame_file(file, vertices, centre))
    return _named_set(file, lambda: read_cache(file, vertices, centre, clip))


def shape_files(place: Path | None, mesh: MeshFile, clip: Clip | None = None) -> Expressions | None:
    """Read expressions from a file, or from the OBJ files of a folder by their names; without a
    place, those of the mesh file. Raises InputError where they are offsets."""
    if place is None:
        return mesh.expressions
    if place.is_dir():
        found = _shape_folder(place, mesh.mesh)
    elif is_cache(place):
        vertices = len(mesh.mesh.positions)
        found = frame_set(place, vertices, mesh.mesh.centre, clip).expressions(vertices)
    else:
        with _named(place):
            check_shape_file(place)
            return read_expressions(place.read_bytes(), place.name, mesh.mesh)
    with _named(place):
        found.check_size(mesh.mesh.positions)
    return found


def _shape_folder(place: Path, mesh: Mesh) -> Expressions:
    """The expressions of the OBJ files of a folder, by their names."""
    every = sorted(f for f in place.iterdir() if f.suffix.lower() == ".obj" and f.is_file())
    if not every:
        raise InputError(f"{place} holds no OBJ files")
    files = [every[i] for i in evenly_spaced(len(every))]
    vertices = len(mesh.positions)
    read = [frame_file(file, vertices, mesh.centre)[0] for file in files]
    return Expressions.checked(np.stack(read), vertices, [file.stem for file in files])


def graph_file(file: Path) -> WrinkleGraph:
    """Read a wrinkle graph."""
    with _named(file):
        return read_graph(file.read_bytes())


def stiffness_files(files: Sequence[Path], mesh: Mesh) -> Stiffness | None:
    """Read stiffness maps, named as those of `scan_files`. None where there are no files."""
    udims = mesh_udims(mesh)
    images = _images(files, udims)
    return read_stiffness(images, udims) if images else None


def mask_files(files: Sequence[Path], mesh: Mesh) -> dict[int, Map]:
    """Read masks of a scan by UDIM, named as those of `scan_files`."""
    udims = mesh_udims(mesh)
    return {**read_painted(_images(files, udims), udims, "mask")}


def control_files(files: Mapping[str, Sequence[Path]], mesh: Mesh) -> Controls | None:
    """Read control maps, named as those of `scan_files`.  files: by the name of the control. None
    where there are no files."""
    udims = mesh_udims(mesh)
    return read_controls({name: _images(named, udims) for name, named in files.items()}, udims)


def scan_files(files: Sequence[Path], mesh: Mesh, settings: ScanSettings, unit: str) -> Scan:
    """Read scanned displacement; each name of a file holds a UDIM.

    files: `<UDIM>` in a name stands for every UDIM.  unit: of the mesh.
    """
    # Imported here: their libraries take longer than to check a mesh.
    from rhytid.formats.scans import read_scan
    from rhytid.meshes.scans import scan_of

    udims = mesh_udims(mesh)
    images = _images(files, udims)
    with working("reading the scan"):
        maps = read_scan(images, udims, partial=settings.partial)
    return scan_of(maps, settings, mesh, unit)


def residual_files(files: Sequence[Path], mesh: Mesh) -> Residual:
    """Read residuals of a traced graph, floats in mesh units, as `scan_files` reads scans. Raises
    InputError for codes and bands."""
    scan = scan_files(files, mesh, ScanSettings(partial=True), "")
    for map in scan.maps.values():
        if map.coded:
            raise InputError(f"{map.name}: a residual is floats in mesh units, as `trace` writes")
    return Residual.of({udim: scan.relief(udim) for udim in scan.maps})


def _images(files: Sequence[Path], udims: Sequence[int]) -> list[tuple[str, bytes]]:
    return [(str(file), file.read_bytes()) for file in every_udim(files, udims)]


def every_udim(files: Sequence[Path], udims: Sequence[int]) -> list[Path]:
    """The files, with those of every UDIM that are there for each with `<UDIM>` in its name."""
    found: list[Path] = []
    for file in files:
        if ANY_UDIM not in file.name:
            found.append(file)
            continue
        every = [file.with_name(file.name.replace(ANY_UDIM, str(udim))) for udim in udims]
        there = [one for one in every if one.is_file()]
        if not there:
            have = ", ".join(str(udim) for udim in udims)
            raise InputError(f"{file}: there is no such file for any UDIM of the mesh, {have}")
        found += there
    return found


def _named_set(file: Path, make: Callable[[], FrameSet]) -> FrameSet:
    with _named(file):
        frames = make()

    def read(index: int) -> NDArray[np.float32]:
        with _named(file):
            return frames.read(index)

    return replace(frames, read=read)


@contextmanager
def _named(file: Path) -> Iterator[None]:
    try:
        yield
    except (InputError, LimitError) as error:
        raise type(error)(f"{file}: {error}") from error
