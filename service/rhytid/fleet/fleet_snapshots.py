"""Snapshots of a fleet, which go by way of the shared folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

from rhytid.durable import reported
from rhytid.engine.messages import AssetInfo
from rhytid.engine_process.remote_snapshots import RemoteSnapshots
from rhytid.engine_process.requests import Request
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.shared_folder import SharedFolder
from rhytid.storage.snapshots import (
    BLOCK,
    PIECE,
    Readable,
    Snapshot,
    SnapshotIndex,
    asset_of,
    index_size,
)


class GivenSnapshot(Snapshot):
    """A snapshot that is a file already, held open; it has no name any more."""

    def __init__(self, file: BinaryIO, index: SnapshotIndex) -> None:
        self.index, self.nbytes = index, index.nbytes
        self._file = file

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the file."""
        with reported("a snapshot cannot be read"):
            self._file.seek(0)
            while piece := self._file.read(PIECE):
                yield piece

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class FleetSnapshots(RemoteSnapshots):
    """The calls of `SnapshotService`."""

    def __init__(self, caller: FleetCaller, shared: SharedFolder) -> None:
        super().__init__(caller)
        self._shared = shared

    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        path: Path = self._supervisor.call(Request("snapshot", (asset,)))
        with reported("a snapshot cannot be read"), ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            path.unlink()
            size = index_size(file.read(BLOCK))
            made = GivenSnapshot(file, SnapshotIndex.decode(file.read(size)))
            stack.pop_all()
            return made

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """As `SnapshotService.restore`."""
        path = self._shared.give(iter(lambda: stream.read(PIECE), b""))
        try:
            with path.open("rb") as file:
                asset = asset_of(file)
            request = Request("restore", (asset, str(path), nbytes))
            found: tuple[AssetInfo, bool] = self._supervisor.call(request)
            return found
        finally:
            with suppress(OSError):
                path.unlink()
