"""NumPy's .npz archives and .npy arrays, as strangers send them.

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
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError
from rhytid.formats.limits import MAX_NUMBERS, check_size

_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Bytes that are unpacked at a time.
_PIECE = 1 << 20
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

    def raising(self, error: type[InputError]) -> Archive:
        """The same archive, whose failures are raised as another error."""
        found = copy(self)
        found._error = error
        return found

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

    def shape(self, name: str) -> tuple[int, ...] | None:
        """The shape of a member by its header alone; None where it is no array of numbers that can
        be read."""
        info = self._members[name]
        try:
            with self._zip.open(info) as stream:
                return read_npy_header(stream.read(MAX_HEADER), name, self._error).shape
        except (*_DAMAGE, self._error):
            return None

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
