"""Files of a skin package as answers: one of them or a part of it, or all as one zip."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import PurePosixPath
from typing import BinaryIO
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from rhytid.api.request_memory import PIECE
from rhytid.durable import reported
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import BusyError, NotFoundError

ZIP = "application/zip"
KINDS = {
    ".json": "application/json",
    ".ktx2": "image/ktx2",
    ".glb": "model/gltf-binary",
    ".bin": "application/octet-stream",
    ".js": "text/javascript; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".mtlx": "application/xml",
}
TEXT = "text/plain; charset=utf-8"
# One range; what is no such range is answered with the whole file.
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII)
# Bytes of a zip beside names and contents: of each file its local header, what follows its bytes,
# and its entry in the directory; the end. From 4 GiB on they are more.
_EACH, _END, _MOST = 30 + 16 + 46, 22, 1 << 31


class OpenPackage:
    """Files of a package, held open, so that they stay whole when it is removed; close it."""

    def __init__(self, package: Package, only: str | None = None) -> None:
        """only: the path of one file; raises NotFoundError where there is none, and
        FileNotFoundError where the package is not there any more."""
        self.key = package.key
        self.sizes = package.files
        if only is not None:
            if only not in package.files:
                raise NotFoundError(f"the package has no file {only!r}")
            self.sizes = {only: package.files[only]}
        self._files: dict[str, BinaryIO] = {}
        with ExitStack() as opened:
            for name in self.sizes:
                self._files[name] = opened.enter_context((package.folder / name).open("rb"))
            self._opened = opened.pop_all()

    def close(self) -> None:
        """Close the files; a second call does nothing."""
        self._opened.close()

    def pieces(self, name: str, start: int, end: int) -> Iterator[bytes]:
        """The bytes of a file from `start` to before `end`."""
        file, left = self._files[name], end - start
        with reported(f"{name} of a package cannot be read"):
            file.seek(start)
            while left and (piece := file.read(min(left, PIECE))):
                left -= len(piece)
                yield piece

    def zipped(self) -> Iterator[bytes]:
        """All files as one zip, stored. The same package gives the same bytes."""
        sink = _Sink()
        with ZipFile(sink, "w", ZIP_STORED) as out:
            for name, size in self.sizes.items():
                about = ZipInfo(name)
                about.file_size, about.external_attr = size, 0o644 << 16
                with out.open(about, "w") as member:
                    for piece in self.pieces(name, 0, size):
                        member.write(piece)
                        yield sink.taken()
                yield sink.taken()
        yield sink.taken()

    @property
    def zip_size(self) -> int | None:
        """Bytes of `zipped`; None of very large ones, where it is not known."""
        names = sum(2 * len(name.encode()) for name in self.sizes)
        size = sum(self.sizes.values()) + names + _EACH * len(self.sizes) + _END
        return size if size < _MOST else None


class _Sink(io.RawIOBase):
    """What is written, until it is taken."""

    def __init__(self) -> None:
        self._held = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: object) -> int:
        view = memoryview(data)  # type: ignore[arg-type]
        self._held += view
        return view.nbytes

    def taken(self) -> bytes:
        held = bytes(self._held)
        self._held.clear()
        return held


def opened(find: Callable[[], Package | JobInfo], only: str | None = None) -> OpenPackage | JobInfo:
    """The files of the package that `find` names, or the job that makes it."""
    for _ in range(3):
        found = find()
        if isinstance(found, JobInfo):
            return found
        try:
            return OpenPackage(found, only)
        except FileNotFoundError:  # removed since: it is made again
            continue
    raise BusyError("packages are removed as fast as they are made: there is no room for them")


def media_type(name: str) -> str:
    """Of a file of a package."""
    return KINDS.get(PurePosixPath(name).suffix, TEXT)


def part(header: str | None, size: int) -> tuple[int, int] | None:
    """The first byte of a range of a file and that after its last; None: the whole file.

    Raises ValueError where the file has no byte of it (RFC 9110, section 14.1.2)."""
    found = _RANGE.fullmatch(header or "")
    if found is None or found.groups() == ("", ""):
        return None
    first, last = found.groups()
    if not first:  # the last so many
        start, end = max(size - int(last), 0), size
    else:
        start, end = int(first), min(int(last) + 1, size) if last else size
        if last and int(last) < start:
            return None
    if start >= end:
        raise ValueError(header)
    return start, end
