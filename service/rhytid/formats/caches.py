"""Geometry caches: animation that is read a frame at a time, from the file itself.

USD and glTF are read by their own modules; the point caches MDD (LightWave) and PC2 (3ds Max) are
read here. Both are a header and float32 positions without a mesh, frame after frame. The header
says how many bytes must follow, and a file of another size is refused before anything is read.

MDD, big-endian: frames, points (int32), a time in seconds for each frame (float32), positions.
PC2, little-endian: "POINTCACHE2" and a zero, version 1, points (int32), frame number of the first
sample, frames from one sample to the next (float32), samples (int32), positions.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import ORIGIN, Centre
from rhytid.domain.wording import install_hint, plural
from rhytid.errors import FrameError, InputError, MeshError
from rhytid.formats.frame_set import Clip, Frame, FrameSet, check_frame_count, frames_at
from rhytid.formats.frames import FRAME_EXTENSIONS, SHAPE_EXTENSIONS
from rhytid.formats.gltf_animation import animated, read_gltf_frames
from rhytid.formats.meshes import MESH_EXTENSIONS, USD_EXTENSIONS, MeshFile, read_mesh

GLTF_EXTENSIONS = (".gltf", ".glb")
CACHE_EXTENSIONS = (*USD_EXTENSIONS, *GLTF_EXTENSIONS, ".mdd", ".pc2")
_CONVERT = "Alembic is not read here: convert it to USD, by usdcat of a USD build or by Blender"
_MDD = struct.Struct(">ii")
_PC2 = struct.Struct("<12siiffi")
_MAGIC = b"POINTCACHE2\0"


def read_mesh_file(file: Path, clip: Clip | None = None) -> MeshFile:
    """The mesh of a file, with the animation that the file holds: of the formats of `read_mesh`,
    and of USD.

    Raises MeshError for an unknown extension, naming those that are known, and what `read_mesh`
    raises.
    """
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


def read_cache(
    file: Path, vertices: int, centre: Centre = ORIGIN, clip: Clip | None = None
) -> FrameSet:
    """The frames of a geometry cache, less the centre of their mesh.

    Raises FrameError where the file does not fit a mesh of so many vertices, MeshError where it is
    damaged, InputError where usd-core is missing, LimitError where it is too large.
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


def is_cache(file: Path) -> bool:
    """Whether the extension of a file is one of those that `read_cache` reads."""
    return file.suffix.lower() in (*CACHE_EXTENSIONS, ".abc")


def check_frame_file(file: Path) -> None:
    """Raise FrameError where the extension of a file is none of a file of frames; the message names
    those that are."""
    known = list(dict.fromkeys([*FRAME_EXTENSIONS, *CACHE_EXTENSIONS]))
    if file.suffix.lower() not in known and not is_cache(file):
        raise FrameError(f"frame file {_unknown(file, known)}")


def check_shape_file(file: Path) -> None:
    """Raise FrameError where the extension of a file is none of a file of expressions; the message
    names those that are."""
    known = list(dict.fromkeys([*SHAPE_EXTENSIONS, *CACHE_EXTENSIONS]))
    if file.suffix.lower() not in known and not is_cache(file):
        raise FrameError(f"shapes {_unknown(file, known)}")


def _unknown(file: Path, known: Iterable[str]) -> str:
    return (
        f"with extension {file.suffix.lower()!r}: must be one of {', '.join(known)} "
        f"(USD needs the extra usd; {install_hint('usd')})"
    )


def _read_mdd(file: Path, vertices: int, centre: Centre, clip: Clip) -> FrameSet:
    """The frames of an MDD file; their numbers are its times, at `clip.fps` frames per second.

    Raises FrameError naming counts that do not fit, or times that are no whole frames, and
    LimitError.
    """
    head = _head(file, _MDD.size, "an MDD file")
    samples, points = _MDD.unpack(head)
    start = _MDD.size + 4 * samples
    _check(file, samples, points, vertices, start, "MDD")
    with file.open("rb") as stream:
        stream.seek(_MDD.size)
        seconds = np.frombuffer(stream.read(4 * samples), ">f4")
    option = f"the times are right for another number of frames per second than {clip.fps:g}"
    times = seconds.astype(np.float64) * clip.fps
    return _frames(file, times, option, start, np.dtype(">f4"), vertices, centre)


def _read_pc2(file: Path, vertices: int, centre: Centre, clip: Clip) -> FrameSet:
    """The frames of a PC2 file; their numbers are by its first frame and its step.

    Raises FrameError naming counts that do not fit, or samples that are no whole frames, and
    LimitError.
    """
    head = _head(file, _PC2.size, "a PC2 file")
    magic, version, points, first, step, samples = _PC2.unpack(head)
    if magic != _MAGIC or version != 1:
        raise FrameError("not a PC2 file of version 1: it must begin with 'POINTCACHE2'")
    _check(file, samples, points, vertices, _PC2.size, "PC2")
    option = f"the file begins at frame {first:g} and steps by {step:g}"
    times = first + step * np.arange(samples, dtype=np.float64)
    return _frames(file, times, option, _PC2.size, np.dtype("<f4"), vertices, centre)


_POINTS = {".mdd": _read_mdd, ".pc2": _read_pc2}


def _head(file: Path, size: int, what: str) -> bytes:
    with file.open("rb") as stream:
        head = stream.read(size)
    if len(head) < size:
        raise FrameError(f"{len(head)} bytes are not {what}: its header has {size}")
    return head


def _check(file: Path, samples: int, points: int, vertices: int, start: int, kind: str) -> None:
    if samples < 1 or points < 1:
        raise FrameError(
            f"the {kind} header has {plural(samples, 'frame')} of {plural(points, 'point')}"
        )
    promised, size = start + 12 * samples * points, file.stat().st_size
    if size != promised:
        raise FrameError(
            f"the {kind} header promises {promised} bytes ({samples} frames of {points} points), "
            f"there are {size}"
        )
    if points != vertices:
        held = plural(vertices, "vertex", "vertices")
        raise FrameError(f"{plural(points, 'point')} per frame, the neutral mesh has {held}")
    check_frame_count(samples)


def _frames(
    file: Path,
    times: NDArray[np.float64],
    option: str,
    start: int,
    dtype: np.dtype[np.float32],
    vertices: int,
    centre: Centre,
) -> FrameSet:
    chosen, numbers = frames_at(times, option)
    size = 12 * vertices

    def read(index: int) -> Frame:
        with file.open("rb") as stream:
            stream.seek(start + chosen[index] * size)
            data = stream.read(size)
        try:
            if len(data) != size:
                raise FrameError("the file has become shorter")
            values = np.frombuffer(data, dtype).reshape(vertices, 3).astype(np.float32)
            return check_positions(values, vertices, centre)
        except FrameError as exc:
            raise FrameError(f"frame {numbers[index]}: {exc}") from exc

    return FrameSet(len(chosen), read, numbers)
