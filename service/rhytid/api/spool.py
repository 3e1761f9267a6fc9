"""Bodies of uploads on disk, in files without a name: they go with the request, however it ends."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import BinaryIO

from starlette.concurrency import run_in_threadpool

from rhytid.engine.byte_budget import Hold
from rhytid.errors import StorageError

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
        self._file: BinaryIO | None = None
        self._written, self._pending = 0, bytearray()

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

    def close(self) -> None:
        """Give disk and memory back."""
        self._pending = bytearray()
        if self._file is not None:
            self._file.close()
        if self._room is not None:
            self._room.release()

    def _append(self, data: bytearray) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 see close
            self._file.write(data)
            self._file.flush()
        except OSError as exc:
            raise StorageError(f"an upload cannot be written to disk: {exc}") from exc
        self._written += len(data)
