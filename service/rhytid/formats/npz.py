"""NumPy's .npz archives: a mesh, and optionally the frames of its animation.

A member's header is read and judged before the member is unpacked, so that neither a header that
promises the world nor a zip bomb makes anything large. Members that are not asked for stay shut.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterable
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import counted_frame
from rhytid.domain.mesh import ORIGIN, Centre, Mesh, subtract_centre
from rhytid.errors import FrameError, InputError, MeshError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, MAX_NUMBERS, check_size
from rhytid.formats.npy import MAX_HEADER, NpyHeader, read_header

_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Bytes that are unpacked at a time.
_PIECE = 1 << 20
_OF_MESH = ("positions", "neutral", "faces", "uv", "face_uv")
_MEMBERS = (*_OF_MESH, "frames", "shapes", "names")
# What zipfile raises over damaged, encrypted and unknown archives.
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, struct.error),
    *(EOFError, OSError, RuntimeError, ValueError),
)


class Archive:
    """The arrays of a .npz file by name; every failure is an `error` that names the member."""

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
        """Bytes of those of these members that are there, by the directory of the archive."""
        return sum(self._members[name].file_size for name in names if name in self._members)

    def _unpack(
        self, name: str, info: zipfile.ZipInfo, stream: IO[bytes], limit: int, names: bool
    ) -> NDArray[Any]:
        head = stream.read(MAX_HEADER)
        header = read_header(head, name, self._error, names=names)
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
    """So many bytes, in memory once, or fewer where the stream ends."""
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


def promised_by_npz(data: bytes) -> int:
    """Bytes of the members that may be read, by the directory of the archive; those of the mesh
    twice, since they are checked as wider numbers. Raises MeshError."""
    archive = Archive(data, MeshError)
    return archive.unpacked(_MEMBERS) + archive.unpacked(_OF_MESH)


def read_npz(data: bytes) -> tuple[Mesh, NDArray[np.float32] | None]:
    """The mesh of a .npz file and its frames (N, V, 3) or None.

    Members: positions (V, 3), or `neutral` in its place, faces (F, 3), uv (T, 2), face_uv (F, 3)
    and optionally frames (N, V, 3). Others are passed over. Raises MeshError, FrameError (the
    contents of the frames) or LimitError.
    """
    archive = Archive(data, MeshError)
    if "positions" in archive and "neutral" in archive:
        raise MeshError("the archive holds both 'positions' and 'neutral': one must go")
    name = "neutral" if "neutral" in archive else "positions"
    mesh = Mesh.centred(*(archive.read(member) for member in (name, "faces", "uv", "face_uv")))
    has_frames = "frames" in archive
    return mesh, _frames(archive, len(mesh.positions), mesh.centre) if has_frames else None


def read_npz_frames(data: bytes, vertices: int, centre: Centre = ORIGIN) -> NDArray[np.float32]:
    """The member `frames` (N, V, 3); FrameError naming the frame and the vertex, or LimitError."""
    return _frames(Archive(data, FrameError), vertices, centre)


def _frames(archive: Archive, vertices: int, centre: Centre) -> NDArray[np.float32]:
    return check_frames(archive.read("frames", MAX_FRAME_NUMBERS), vertices, centre)


def check_frames(
    values: NDArray[Any], vertices: int, centre: Centre = ORIGIN
) -> NDArray[np.float32]:
    """Frames as (N, V, 3) float32 less the centre of their mesh, finite, read-only; FrameError
    naming the first that is not."""
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
        raise FrameError(f"{where} is {frames[frame, vertex].tolist()}: not finite")
    frames.setflags(write=False)
    return frames
