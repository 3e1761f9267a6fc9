"""Bodies of uploads on disk, in files without a name: they go with the request, however it ends."""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterable, Iterator
from io import FileIO
from pathlib import Path

from starlette.concurrency import run_in_threadpool

from rhytid.engine.byte_budget import Hold
from rhytid.errors import HostBusyError, HostMemoryError, StorageError
from rhytid.support.atomic_files import storage_errors

logger = logging.getLogger(__name__)
# Bytes that are gathered in memory before they are written; what is smaller needs no file.
PIECE = 1 << 20


class Spool:
    """What one body holds, in the order in which it came.

    room: what is on disk is counted there; None = nothing counts it, and nothing is written.
    folder: of the file; None = that of temporary files.
    """

    def __init__(self, room: Hold | None = None, folder: Path | None = None) -> None:
        self.size = 0
        self._room, self._folder = room, folder
        self._file: FileIO | None = None
        self._written, self._pending = 0, bytearray()

    @classmethod
    def at(cls, folder: Path, room: Hold) -> Spool:
        """A new one in a folder, or where temporary files are if that does not exist."""
        return cls(room, folder if folder.is_dir() else None)

    def write(self, data: bytes | memoryview) -> None:
        """Put bytes at the end; they are in memory until `settle`."""
        self._pending += data
        self.size += len(data)

    async def settle(self) -> None:
        """Write to disk where much has come; raises HostBusyError where uploads hold too much of
        it already, StorageError where it fails."""
        if self._room is None or len(self._pending) < PIECE:
            return
        data, self._pending = self._pending, bytearray()
        await self._room.grow_async(len(data))
        await run_in_threadpool(self._append, data)

    def read(self, start: int, size: int) -> bytes:
        """So many bytes from `start` on."""
        on_disk = max(min(self._written - start, size), 0)
        pending = bytes(self._pending[max(start - self._written, 0) :][: size - on_disk])
        if self._file is None or on_disk == 0:
            return pending
        parts, at = [], start
        while at < start + on_disk:  # one call reads 2 GiB at most
            parts.append(os.pread(self._file.fileno(), start + on_disk - at, at))
            at += len(parts[-1])
        return b"".join((*parts, pending)) if pending or len(parts) > 1 else parts[0]

    def fill(self, data: bytes | memoryview) -> None:
        """Put bytes at the end, on disk at once; raises what `settle` does."""
        if self._room is not None:
            self._room.grow(len(data))
        self.size += len(data)
        self._append(data)

    def filled(self, pieces: Iterable[bytes | memoryview], otherwise: str) -> bool:
        """Whether the disk takes these pieces; it is closed where it does not, and a warning says
        what happens otherwise."""
        try:
            for piece in pieces:
                self.fill(piece)
        except (HostBusyError, HostMemoryError, StorageError) as error:
            logger.warning("%s: %s", otherwise, error)
            self.close()
            return False
        except BaseException:
            self.close()
            raise
        return True

    def descriptor(self) -> int:
        """Of a file with all of it, which stays the spool's; raises what `settle` does."""
        data, self._pending = self._pending, bytearray()
        if self._room is not None:
            self._room.grow(len(data))
        self._append(data)
        assert self._file is not None
        return self._file.fileno()

    def reader(self) -> SpoolReader:
        """Reads it from the start."""
        return SpoolReader(self)

    def pieces(self, size: int) -> Iterator[bytes]:
        """All of it, so many bytes at a time."""
        return (self.read(start, size) for start in range(0, self.size, size))

    def close(self) -> None:
        """Give disk and memory back."""
        self._pending = bytearray()
        if self._file is not None:
            self._file.close()
        if self._room is not None:
            self._room.release()

    def _append(self, data: bytes | bytearray | memoryview) -> None:
        with storage_errors("an upload cannot be written to disk"):
            if self._file is None:
                # Without a buffer of Python's, which would be written once more on closing.
                self._file = tempfile.TemporaryFile("w+b", 0, dir=self._folder)  # noqa: SIM115
            view = memoryview(data)
            while view:  # one call writes 2 GiB at most, or what is left of the disk
                view = view[self._file.write(view) :]
        self._written += len(data)


class SpoolReader:
    """A spool as a file that is read from its start."""

    def __init__(self, spool: Spool) -> None:
        self._spool, self._at = spool, 0

    def read(self, size: int) -> bytes:
        """The next bytes, at most `size`; empty at the end."""
        data = self._spool.read(self._at, size)
        self._at += len(data)
        return data
