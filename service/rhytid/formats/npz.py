"""NumPy's .npz archives with a mesh, and optionally its shapes and the frames of its animation."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.frame import counted_frame
from rhytid.domain.mesh import ORIGIN, Centre, Mesh, add_centre, subtract_centre
from rhytid.domain.notices import ARRAYS_NOT_READ, Notice
from rhytid.domain.warnings import ARRAYS_UNUSED, InputWarning
from rhytid.errors import FrameError, MeshError, ShapesError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size
from rhytid.formats.npz_archive import Archive

_OF_MESH = ("positions", "neutral", "faces", "uv", "face_uv")
_OPTIONAL = ("frames", "shapes", "names")
_MEMBERS = (*_OF_MESH, *_OPTIONAL)
# Members that are not read and told by name; and how alike names are, of 1, where one is a slip.
_TOLD, _NEAR = 8, 0.75
# Slips are looked for among so many members, in names of so many characters: archives may have
# millions, and names of 64 KiB.
_LOOKED_AT, _LONGEST = 1000, 64


def promised_by_npz(data: bytes) -> int:
    """Bytes that the members which may be read take once they are unpacked, by the directory of the
    archive.

    The members of the mesh count twice, since they are checked as wider numbers. Raises MeshError.
    """
    archive = Archive(data, MeshError)
    return archive.unpacked(_MEMBERS) + archive.unpacked(_OF_MESH)


@dataclass(frozen=True, eq=False)
class NpzMesh:
    """What a .npz file with a mesh holds.

    frames: (N, V, 3) or None.  unused: warnings of members that nothing reads and whose names are
    nearly those of members that would be read and are not there, or whose shape is that of
    expressions.  notices: of other members that nothing reads: `uv2` beside `uv` is no slip.
    """

    mesh: Mesh
    frames: NDArray[np.float32] | None
    shapes: Expressions | None
    unused: tuple[InputWarning, ...]
    notices: tuple[Notice, ...]


def read_npz(data: bytes) -> NpzMesh:
    """The mesh of a .npz file, with its frames and shapes.

    Members: positions (V, 3), or `neutral` in its place, faces (F, 3), uv (T, 2), face_uv (F, 3)
    and optionally frames (N, V, 3), shapes (E, V, 3) and their names (E,). Raises MeshError,
    FrameError (the contents of the frames), ShapesError (what is wrong with shapes) or LimitError.
    """
    archive = Archive(data, MeshError)
    if "positions" in archive and "neutral" in archive:
        raise MeshError("the archive holds both 'positions' and 'neutral': one must go")
    name = "neutral" if "neutral" in archive else "positions"
    mesh = Mesh.centred(*(archive.read(member) for member in (name, "faces", "uv", "face_uv")))
    vertices, frames, shapes = len(mesh.positions), None, None
    if "frames" in archive:
        frames = _frames(archive, vertices, mesh.centre)
    if "shapes" in archive:
        shapes = _shapes(archive.raising(ShapesError), vertices, mesh.centre)
        shapes.check_size(mesh.positions)
    return NpzMesh(mesh, frames, shapes, *_unread(archive, vertices))


def _unread(archive: Archive, vertices: int) -> tuple[tuple[InputWarning, ...], tuple[Notice, ...]]:
    """Warnings and notices of the members of a mesh that nothing reads."""
    slips, others = _slips(archive, _OPTIONAL, vertices)
    detail = f"not read: {_told(slips)}; arrays of a mesh are {', '.join(_MEMBERS)}"
    warning = InputWarning(ARRAYS_UNUSED, detail, "the mesh file")
    notice = Notice(
        ARRAYS_NOT_READ, f"the mesh file has arrays that are not read: {_told((), others)}"
    )
    return (warning,) if slips else (), (notice,) if others else ()


def _slips(archive: Archive, wanted: Iterable[str], vertices: int) -> tuple[list[str], list[str]]:
    """Members that nothing reads: likely slips for those of the wanted that are not there, as they
    are told, and the names of others."""
    missing = [name for name in wanted if name not in archive]
    strange = [name for name in archive if name not in _MEMBERS]
    short = [name for name in strange[:_LOOKED_AT] if len(name) <= _LONGEST]
    meant = {
        name: f"did you mean {near}?" for name in short if (near := _meant(name.lower(), missing))
    }
    if "shapes" in missing:
        others = [name for name in short if name not in meant]
        meant.update(_expressions(archive, others[:_TOLD], vertices))
    slips = [f"{_quoted(name)} ({what})" for name, what in meant.items()]
    return slips, [name for name in strange if name not in meant]


def _expressions(archive: Archive, names: Iterable[str], vertices: int) -> dict[str, str]:
    """What is told of members (N, V, 3) of whatever name, as expressions are: whether these are
    positions or offsets is not known here. With as many N as there are frames they are something
    else of each frame, such as velocities."""
    shapes = {name: archive.shape(name) for name in names}
    frames = archive.shape("frames") if "frames" in archive else None
    return {
        name: (
            f"{shape[0]} expressions? give their positions of all {vertices} vertices as shapes, "
            "with names; offsets are to be added to those of the mesh"
        )
        for name, shape in shapes.items()
        if shape is not None and len(shape) == 3 and shape[1:] == (vertices, 3) and shape != frames
    }


def _meant(name: str, missing: Sequence[str]) -> str | None:
    """Which of the missing members a name is likely meant for, `blendshapes` for shapes, too; and
    `shape_names` for their names, where they are there."""
    for word in ("shapes", "names"):
        if name.endswith(word) and word in missing and ("shapes" in missing) == (word == "shapes"):
            return word
    return next(iter(get_close_matches(name, missing, 1, _NEAR)), None)


def _told(texts: Sequence[str], names: Sequence[str] = ()) -> str:
    told = [*texts[:_TOLD], *map(_quoted, names[:_TOLD])][:_TOLD]
    more = len(texts) + len(names) - len(told)
    return ", ".join(told) + (f" and {more} more" if more else "")


def _quoted(name: str) -> str:
    return f"{name[:40]!r:.40}"


def read_npz_frames(data: bytes, vertices: int, centre: Centre = ORIGIN) -> NDArray[np.float32]:
    """The member `frames` (N, V, 3) of a .npz file, less the centre of the mesh; raises FrameError
    naming the frame and the vertex, or LimitError."""
    return _frames(Archive(data, FrameError), vertices, centre)


def _frames(
    archive: Archive, vertices: int, centre: Centre, error: type[FrameError] = FrameError
) -> NDArray[np.float32]:
    return check_frames(archive.read("frames", MAX_FRAME_NUMBERS), vertices, centre, error)


def check_frames(
    values: NDArray[Any],
    vertices: int,
    centre: Centre = ORIGIN,
    error: type[FrameError] = FrameError,
) -> NDArray[np.float32]:
    """Frames as (N, V, 3) float32 less the centre of their mesh, read-only; raises `error` where
    the shape is another, or naming the first vertex that is not finite."""
    if values.ndim != 3 or values.shape[1:] != (vertices, 3):
        raise error(f"frames have shape {values.shape}, not (N, {vertices}, 3)")
    with np.errstate(over="ignore"):
        if centre.any():  # one by one: all of them in double would take twice the memory
            frames = np.empty(values.shape, np.float32)
            for frame, sent in zip(frames, values, strict=True):
                frame[:] = subtract_centre(sent, centre)
        else:
            frames = np.require(values, np.float32, ["C", "A"])
    finite = np.isfinite(frames).all(axis=2)
    if not finite.all():
        frame, vertex = np.unravel_index(int(np.argmin(finite)), finite.shape)
        where = f"frame {counted_frame(int(frame))}, vertex {vertex}"
        raise error(f"{where} is {frames[frame, vertex].tolist()}: not finite as float32")
    frames.setflags(write=False)
    return frames


def read_npz_expressions(data: bytes, vertices: int, centre: Centre = ORIGIN) -> Expressions:
    """The members `shapes` (E, V, 3) and `names` (E,) of a .npz file, or else its frames; raises
    ShapesError where it has neither, with what may have been meant to be, or naming what is wrong,
    or LimitError."""
    archive = Archive(data, ShapesError)
    if "shapes" in archive:
        return _shapes(archive, vertices, centre)
    if "frames" in archive:
        # These are less the centre already.
        return Expressions.checked(_frames(archive, vertices, centre, ShapesError), vertices)
    slips, others = _slips(archive, ("shapes", "frames"), vertices)
    known = [name for name in _MEMBERS if name in archive]
    held = _told(slips, [*others, *known]) or "nothing"
    raise ShapesError(f"the archive has neither 'shapes' nor 'frames'; it has {held}")


def _shapes(archive: Archive, vertices: int, centre: Centre) -> Expressions:
    names = None
    if "names" in archive:
        texts = archive.read("names", names=True)
        if texts.ndim != 1:
            raise ShapesError(f"names have shape {texts.shape}, not (E,)")
        names = [str(text) for text in texts]
    shapes = archive.read("shapes", MAX_FRAME_NUMBERS)
    return Expressions.checked(shapes, vertices, names, centre)


def write_mesh_npz(
    path: Path,
    mesh: Mesh,
    shapes: Expressions | None,
    frames: Iterable[NDArray[np.float32]],
    count: int,
) -> None:
    """Write a new file with the mesh, its shapes by name, and `count` frames (V, 3).

    Positions are written where they were before the centre was subtracted: as doubles where there
    is a centre. Raises LimitError where there are more frames than are read from one file.
    """
    check_size("the frames", mesh.positions.size * count, MAX_FRAME_NUMBERS)
    with path.open("xb") as file:
        with zipfile.ZipFile(file, "w") as archive:
            for name, values in _arrays(mesh, shapes).items():
                with _member(archive, name) as member:
                    np.lib.format.write_array(member, values, allow_pickle=False)
            if count:
                with _member(archive, "frames") as member:
                    _write_frames(member, mesh, frames, count)
        file.flush()
        os.fsync(file.fileno())


def _arrays(mesh: Mesh, shapes: Expressions | None) -> Mapping[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        "positions": add_centre(mesh.positions, mesh.centre),
        "faces": mesh.faces,
        "uv": mesh.uv,
        "face_uv": mesh.face_uv,
    }
    if shapes is not None:
        arrays["shapes"] = add_centre(shapes.positions, mesh.centre)
        arrays["names"] = np.array(shapes.names, np.str_)
    return arrays


def _write_frames(
    member: IO[bytes], mesh: Mesh, frames: Iterable[NDArray[np.float32]], count: int
) -> None:
    kind = np.dtype("<f8" if mesh.centre.any() else "<f4")
    shape = (count, *mesh.positions.shape)
    header = {"descr": kind.str, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(member, header)
    for frame in frames:
        member.write(np.ascontiguousarray(add_centre(frame, mesh.centre), kind).tobytes())


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    # The date is always the same, so that the same content has the same bytes.
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)
