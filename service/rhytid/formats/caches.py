"""Geometry caches: animation that is read a frame at a time, from the file itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rhytid.domain.origin import ORIGIN, Centre
from rhytid.errors import InputError
from rhytid.formats.frame_set import Clip, FrameSet
from rhytid.formats.gltf_animation import animated, read_gltf_frames
from rhytid.formats.meshes import USD_EXTENSIONS, MeshFile, read_mesh
from rhytid.formats.point_caches import read_mdd, read_pc2

GLTF_EXTENSIONS = (".gltf", ".glb")
_POINTS = {".mdd": read_mdd, ".pc2": read_pc2}
CACHE_EXTENSIONS = (*USD_EXTENSIONS, *GLTF_EXTENSIONS, *_POINTS)
_CONVERT = "Alembic is not read here: convert it to USD, by usdcat of a USD build or by Blender"


def is_cache(file: Path) -> bool:
    """Whether `read_cache` is to read the frames of a file."""
    return file.suffix.lower() in (*CACHE_EXTENSIONS, ".abc")


def read_cache(
    file: Path, vertices: int, centre: Centre = ORIGIN, clip: Clip | None = None
) -> FrameSet:
    """The frames of a geometry cache, less the centre of their mesh.

    Raises FrameError naming what does not fit the mesh of so many vertices, MeshError over damaged
    files, InputError where usd-core is missing, LimitError.
    """
    clip, extension = clip or Clip(), file.suffix.lower()
    if extension == ".abc":
        raise InputError(_CONVERT)
    if extension in _POINTS:
        return _POINTS[extension](file, vertices, centre, clip)
    if extension in GLTF_EXTENSIONS:
        return read_gltf_frames(file.read_bytes(), file.name, vertices, centre, clip)
    from rhytid.formats.usd import read_usd_frames

    return read_usd_frames(file, vertices, centre, clip)


def read_mesh_file(file: Path, clip: Clip | None = None) -> MeshFile:
    """A mesh from a file, with the animation that it holds; as `read_mesh`, and USD."""
    clip, extension = clip or Clip(), file.suffix.lower()
    if extension == ".abc":
        raise InputError(_CONVERT)
    if extension in USD_EXTENSIONS:
        from rhytid.formats.usd import read_usd

        return read_usd(file, clip)
    data = file.read_bytes()
    found = read_mesh(data, file.name)
    if extension not in GLTF_EXTENSIONS or not animated(data, file.name):
        return found
    vertices, centre = len(found.mesh.positions), found.mesh.centre
    return replace(
        found,
        animation=lambda: read_gltf_frames(data, file.name, vertices, centre, clip),
    )
