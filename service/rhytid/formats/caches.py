"""Geometry caches: animation that is read a frame at a time, from the file itself."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rhytid.domain.mesh import ORIGIN, Centre
from rhytid.domain.wording import install_hint
from rhytid.errors import FrameError, InputError, MeshError
from rhytid.formats.expressions import SHAPE_EXTENSIONS
from rhytid.formats.frame_set import Clip, FrameSet
from rhytid.formats.frames import FRAME_EXTENSIONS
from rhytid.formats.gltf_animation import animated, read_gltf_frames
from rhytid.formats.meshes import MESH_EXTENSIONS, USD_EXTENSIONS, MeshFile, read_mesh
from rhytid.formats.point_caches import read_mdd, read_pc2

GLTF_EXTENSIONS = (".gltf", ".glb")
_POINTS = {".mdd": read_mdd, ".pc2": read_pc2}
CACHE_EXTENSIONS = (*USD_EXTENSIONS, *GLTF_EXTENSIONS, *_POINTS)
_CONVERT = "Alembic is not read here: convert it to USD, by usdcat of a USD build or by Blender"


def check_frame_file(file: Path) -> None:
    """Raise FrameError naming what files of frames may be, for one of another extension."""
    known = list(dict.fromkeys([*FRAME_EXTENSIONS, *CACHE_EXTENSIONS]))
    if file.suffix.lower() not in known and not is_cache(file):
        raise FrameError(f"frame file {_unknown(file, known)}")


def check_shape_file(file: Path) -> None:
    """The same of a file of expressions."""
    known = list(dict.fromkeys([*SHAPE_EXTENSIONS, *CACHE_EXTENSIONS]))
    if file.suffix.lower() not in known and not is_cache(file):
        raise FrameError(f"shapes {_unknown(file, known)}")


def _unknown(file: Path, known: Iterable[str]) -> str:
    return (
        f"with extension {file.suffix.lower()!r}: must be one of {', '.join(known)} "
        f"(USD needs the extra usd; {install_hint('usd')})"
    )


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
    """A mesh from a file, with the animation that it holds; as `read_mesh`, and USD. Raises
    MeshError naming what mesh files may be, for one of another extension."""
    clip, extension = clip or Clip(), file.suffix.lower()
    if extension == ".abc":
        raise InputError(_CONVERT)
    if extension in USD_EXTENSIONS:
        from rhytid.formats.usd import read_usd

        return read_usd(file, clip)
    if extension not in MESH_EXTENSIONS:
        raise MeshError(f"mesh file {_unknown(file, (*MESH_EXTENSIONS, *USD_EXTENSIONS))}")
    data = file.read_bytes()
    found = read_mesh(data, file.name)
    if extension not in GLTF_EXTENSIONS or not animated(data, file.name):
        return found
    vertices, centre = len(found.mesh.positions), found.mesh.centre
    return replace(
        found,
        animation=lambda: read_gltf_frames(data, file.name, vertices, centre, clip),
    )
