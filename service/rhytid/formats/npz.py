"""NumPy's .npz archives and .npy arrays: a mesh, and optionally the frames of its animation.

numpy's own reader allocates what a header asks for, runs pickles when told to, and warns about
headers that it cannot quite read. Here the header of an array says how many bytes must follow, or
it is refused. It is checked before a member of an archive is unpacked, so that neither a header
that promises too much nor a zip bomb makes anything large. Members that are not asked for are not
read.
"""

from __future__ import annotations

import ast
import io
import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.frame import counted_frame
from rhytid.domain.mesh import ORIGIN, Centre, Mesh, add_centre, subtract_centre
from rhytid.domain.warnings import ARRAYS_UNUSED, InputWarning
from rhytid.errors import FrameError, InputError, MeshError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, MAX_NUMBERS, check_size

_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Bytes that are unpacked at a time.
_PIECE = 1 << 20
_OF_MESH = ("positions", "neutral", "faces", "uv", "face_uv")
_OPTIONAL = ("frames", "shapes", "names")
_MEMBERS = (*_OF_MESH, *_OPTIONAL)
# Members that are not read and told by name; and how alike names are, of 1, where one is a slip.
_TOLD, _NEAR = 8, 0.75
# The errors of zipfile for damaged, encrypted and unknown archives.
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, struct.error),
    *(EOFError, OSError, RuntimeError, ValueError),
)
_MAGIC = b"\x93NUMPY"
_DTYPE = re.compile(r"[<>=|]?[fiu](?:1|2|4|8|16)", re.ASCII)
_TEXT = re.compile(r"[<>=|]?U[0-9]{1,4}", re.ASCII)
_KINDS = {
    "O": "Python objects (a pickle)",
    "S": "text",
    "U": "text",
    "c": "complex numbers",
    "b": "truth values",
    "V": "records",
    "M": "dates",
    "m": "time spans",
}
# No header of a plain array comes near this; more need not be read to judge one.
MAX_HEADER = 10_000


def promised_by_npz(data: bytes) -> int:
    """Bytes that the members which may be read take once they are unpacked, by the directory of the
    archive.

    The members of the mesh count twice, since they are checked as wider numbers. Raises MeshError.
    """
    archive = Archive(data, MeshError)
    return archive.unpacked(_MEMBERS) + archive.unpacked(_OF_MESH)


def read_npz(data: bytes) -> tuple[Mesh, NDArray[np.float32] | None]:
    """The mesh of a .npz file and its frames (N, V, 3) or None.

    Members: positions (V, 3), or `neutral` in its place, faces (F, 3), uv (T, 2), face_uv (F, 3)
    and optionally frames (N, V, 3). Others are passed over: `unread_arrays`. Raises MeshError,
    FrameError (the contents of the frames) or LimitError.
    """
    archive = Archive(data, MeshError)
    if "positions" in archive and "neutral" in archive:
        raise MeshError("the archive holds both 'positions' and 'neutral': one must go")
    name = "neutral" if "neutral" in archive else "positions"
    mesh = Mesh.centred(*(archive.read(member) for member in (name, "faces", "uv", "face_uv")))
    has_frames = "frames" in archive
    return mesh, _frames(archive, len(mesh.positions), mesh.centre) if has_frames else None


def unread_arrays(data: bytes) -> tuple[tuple[InputWarning, ...], tuple[str, ...]]:
    """What to tell of the members of a .npz file with a mesh that nothing reads: a warning of those
    whose name is nearly that of a member that would be read and is not there, and a note of the
    others: `uv2` beside `uv` is no slip."""
    archive = Archive(data, MeshError)
    slips, others = _slips(archive, _OPTIONAL)
    detail = f"not read: {_told(slips)}; arrays of a mesh are {', '.join(_MEMBERS)}"
    warning = InputWarning(ARRAYS_UNUSED, detail, "the mesh file")
    note = f"arrays of the mesh file that are not read: {_told(others)}"
    return (warning,) if slips else (), (note,) if others else ()


def _slips(archive: Archive, wanted: Iterable[str]) -> tuple[list[str], list[str]]:
    """Members that nothing reads: likely slips for those of the wanted that are not there, and
    others."""
    missing = [name for name in wanted if name not in archive]
    strange = [name for name in archive if name not in _MEMBERS]
    meant = {name: _meant(name.lower(), missing) for name in strange}
    slips = [f"{name!r:.40} (did you mean {near}?)" for name, near in meant.items() if near]
    return slips, [f"{name!r:.40}" for name, near in meant.items() if not near]


def _meant(name: str, missing: Sequence[str]) -> str | None:
    """Which of the missing members a name is likely meant for, `blendshapes` for shapes, too; and
    `shape_names` for their names, where they are there."""
    for word in ("shapes", "names"):
        if name.endswith(word) and word in missing and ("shapes" in missing) == (word == "shapes"):
            return word
    return next(iter(get_close_matches(name, missing, 1, _NEAR)), None)


def _told(names: list[str]) -> str:
    more = f" and {len(names) - _TOLD} more" if len(names) > _TOLD else ""
    return ", ".join(names[:_TOLD]) + more


def read_npz_frames(data: bytes, vertices: int, centre: Centre = ORIGIN) -> NDArray[np.float32]:
    """The member `frames` (N, V, 3) of a .npz file, less the centre of the mesh; raises FrameError
    naming the frame and the vertex, or LimitError."""
    return _frames(Archive(data, FrameError), vertices, centre)


def _frames(archive: Archive, vertices: int, centre: Centre) -> NDArray[np.float32]:
    return check_frames(archive.read("frames", MAX_FRAME_NUMBERS), vertices, centre)


def check_frames(
    values: NDArray[Any], vertices: int, centre: Centre = ORIGIN
) -> NDArray[np.float32]:
    """Frames as (N, V, 3) float32 less the centre of their mesh, read-only; raises FrameError where
    the shape is another, or naming the first vertex that is not finite."""
    if values.ndim != 3 or values.shape[1:] != (vertices, 3):
        raise FrameError(f"frames have shape {values.shape}, not (N, {vertices}, 3)")
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
        raise FrameError(f"{where} is {frames[frame, vertex].tolist()}: not finite as float32")
    frames.setflags(write=False)
    return frames


def read_npz_shapes(data: bytes, vertices: int, centre: Centre = ORIGIN) -> Expressions | None:
    """The members `shapes` (E, V, 3) and `names` (E,) of a .npz file as expressions; None where
    there is no `shapes`. Raises FrameError or LimitError."""
    archive = Archive(data, FrameError)
    return _shapes(archive, vertices, centre) if "shapes" in archive else None


def read_npz_expressions(data: bytes, vertices: int, centre: Centre = ORIGIN) -> Expressions:
    """As `read_npz_shapes`, or else the frames of the file; raises FrameError where it has neither,
    with what may have been meant to be."""
    archive = Archive(data, FrameError)
    if "shapes" in archive:
        return _shapes(archive, vertices, centre)
    if "frames" in archive:
        # These are less the centre already.
        return Expressions.checked(_frames(archive, vertices, centre), vertices)
    slips, others = _slips(archive, ("shapes", "frames"))
    known = [repr(name) for name in _MEMBERS if name in archive]
    held = _told([*slips, *others, *known]) or "nothing"
    raise FrameError(f"the archive has neither 'shapes' nor 'frames'; it has {held}")


def _shapes(archive: Archive, vertices: int, centre: Centre) -> Expressions:
    names = None
    if "names" in archive:
        texts = archive.read("names", names=True)
        if texts.ndim != 1:
            raise FrameError(f"names have shape {texts.shape}, not (E,)")
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


class Archive:
    """The arrays of a .npz file by name. Every failure is raised as `error`, with the name of the
    member."""

    def __init__(self, data: bytes, error: type[InputError]) -> None:
        self._error = error
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        except _DAMAGE as exc:
            raise error(f"not a readable .npz archive: {exc}") from exc
        self._members: dict[str, zipfile.ZipInfo] = {}
        for info in self._zip.infolist():
            name = info.filename.removesuffix(".npy")
            if name in self._members:
                raise error(f"the archive holds {name!r} more than once")
            self._members[name] = info

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def read(self, name: str, limit: int = MAX_NUMBERS, *, names: bool = False) -> NDArray[Any]:
        """One array of integers or real numbers, or of text where `names` are read."""
        info = self._members.get(name)
        if info is None:
            raise self._error(f"the archive has no {name!r}; it has {self._listed()}")
        if info.compress_type not in _PACKINGS:
            raise self._error(f"{name} is packed by method {info.compress_type}: not read here")
        try:
            with self._zip.open(info) as stream:
                return self._unpack(name, info, stream, limit, names)
        except _DAMAGE as exc:
            raise self._error(f"{name} cannot be unpacked: {exc}") from exc

    def unpacked(self, names: Iterable[str]) -> int:
        """Bytes of the named members once they are unpacked, by the directory of the archive; names
        that are not there do not count."""
        return sum(self._members[name].file_size for name in names if name in self._members)

    def _unpack(
        self, name: str, info: zipfile.ZipInfo, stream: IO[bytes], limit: int, names: bool
    ) -> NDArray[Any]:
        head = stream.read(MAX_HEADER)
        header = read_npy_header(head, name, self._error, names=names)
        check_size(name, header.numbers, limit)
        self._check_length(name, header, info.file_size)
        data = _read(head, stream, header.start + header.stored)
        self._check_length(name, header, len(data))
        return header.array(data)

    def _check_length(self, name: str, header: NpyHeader, length: int) -> None:
        promised = header.start + header.stored
        if length != promised:
            raise self._error(f"{name}: the header promises {promised} bytes, there are {length}")

    def _listed(self) -> str:
        names = list(self._members)
        return ", ".join(repr(n)[:40] for n in names[:10]) + (", …" if len(names) > 10 else "")


def _read(head: bytes, stream: IO[bytes], size: int) -> bytearray:
    """The first `size` bytes, of which `head` is read already; fewer where the stream ends."""
    data = bytearray(size)
    data[: len(head)] = head[:size]
    at = min(len(head), size)
    while at < size:
        more = stream.read(min(size - at, _PIECE))
        if not more:
            return data[:at]
        data[at : at + len(more)] = more
        at += len(more)
    return data


@dataclass(frozen=True)
class NpyHeader:
    """The header of a .npy file. `start`: bytes before the data."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran_order: bool
    start: int

    @property
    def numbers(self) -> int:
        """How many numbers follow the header."""
        return math.prod(self.shape)

    @property
    def stored(self) -> int:
        """How many bytes follow the header."""
        return self.numbers * self.dtype.itemsize

    def array(self, data: bytes | bytearray) -> NDArray[Any]:
        """The array of the whole .npy file `data`, whose length has been checked."""
        flat = np.frombuffer(data, self.dtype, self.numbers, self.start)
        return flat.reshape(self.shape, order="F" if self.fortran_order else "C")


def read_npy_header(
    data: bytes, what: str, error: type[InputError], *, names: bool = False
) -> NpyHeader:
    """The header at the start of `data`, which are the first MAX_HEADER bytes of a file, or more.

    Raises `error`, naming `what`, where it is not the header of an array of integers or real
    numbers, or with `names` of text.
    """
    text, start = _header_text(data, what, error)
    try:
        fields = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as exc:
        raise error(f"{what}: the .npy header cannot be read") from exc
    if not isinstance(fields, dict) or set(fields) != {"descr", "fortran_order", "shape"}:
        raise error(f"{what}: the .npy header must hold descr, fortran_order and shape")
    dtype = _text(fields["descr"], what, error) if names else _dtype(fields["descr"], what, error)
    shape, fortran_order = fields["shape"], fields["fortran_order"]
    if not isinstance(shape, tuple) or len(shape) > 4 or not all(map(_is_length, shape)):
        raise error(f"{what}: the .npy header has shape {shape!r:.80}")
    if type(fortran_order) is not bool:
        raise error(f"{what}: the .npy header has fortran_order {fortran_order!r:.80}")
    return NpyHeader(dtype, shape, fortran_order, start)


def _is_length(value: object) -> bool:
    return type(value) is int and 0 <= value < 1 << 40


def _header_text(data: bytes, what: str, error: type[InputError]) -> tuple[str, int]:
    """Version 1 counts the header in 2 bytes, versions 2 and 3 in 4."""
    if data[:6] != _MAGIC or data[6:8] not in (b"\x01\x00", b"\x02\x00", b"\x03\x00"):
        raise error(f"{what} is not a .npy array of version 1, 2 or 3")
    first = 10 if data[6] == 1 else 12
    start = first + int.from_bytes(data[8:first], "little")
    if start > MAX_HEADER:
        raise error(f"{what}: the .npy header is {start} bytes: at most {MAX_HEADER}")
    if len(data) < start:
        raise error(f"{what} ends inside its .npy header")
    return data[first:start].decode("latin-1"), start


def _text(descr: object, what: str, error: type[InputError]) -> np.dtype[Any]:
    if isinstance(descr, str) and _TEXT.fullmatch(descr):
        return np.dtype(descr)
    raise error(f"{what} has dtype {descr!r:.80}: must be text, as of np.array(['jawOpen', …])")


def _dtype(descr: object, what: str, error: type[InputError]) -> np.dtype[Any]:
    if isinstance(descr, str) and _DTYPE.fullmatch(descr):
        try:
            return np.dtype(descr)
        except TypeError as exc:  # "f1", or "f16" where the machine has none
            raise error(f"{what} has dtype {descr!r}, which does not exist here") from exc
    code = descr.lstrip("<>=|")[:1] if isinstance(descr, str) else "V"
    kind = _KINDS.get(code, f"{descr!r:.80}")
    raise error(f"{what} holds {kind}: only integers and real numbers are read")
