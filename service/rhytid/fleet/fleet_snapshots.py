"""Snapshots of a fleet, which go by way of the shared folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from rhytid.engine.messages import AssetInfo
from rhytid.engine.operations import OPERATIONS
from rhytid.engine_process.envelope import Request
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
from rhytid.support.atomic_files import storage_errors


class GivenSnapshot(Snapshot):
    """A snapshot that is a file already, held open; it has no name any more."""

    def __init__(self, file: BinaryIO, index: SnapshotIndex) -> None:
        self.index, self.nbytes = index, index.nbytes
        self._file = file

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the file."""
        with storage_errors("a snapshot cannot be read"):
            self._file.seek(0)
            while piece := self._file.read(PIECE):
                yield piece

    def close(self) -> None:
        """Close the file."""
        self._file.close()


@dataclass(frozen=True)
class SharedSnapshot:
    """A snapshot in the shared folder, in place of its bytes.  asset: the one that it is of."""

    asset: str
    path: Path


class FleetSnapshots:
    """Gives snapshots to replicas and takes theirs, by way of the shared folder."""

    def __init__(self, caller: FleetCaller, shared: SharedFolder) -> None:
        self._caller, self._shared = caller, shared

    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        path: Path = self._caller.call(Request(OPERATIONS["snapshots.of"], (asset,)))
        with storage_errors("a snapshot cannot be read"), ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            path.unlink()
            size = index_size(file.read(BLOCK))
            made = GivenSnapshot(file, SnapshotIndex.decode(file.read(size)))
            stack.pop_all()
            return made

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """The asset of a snapshot of so many bytes, and whether it is new."""
        path = self._shared.give(iter(lambda: stream.read(PIECE), b""))
        try:
            with path.open("rb") as file:
                asset = asset_of(file)
            content = SharedSnapshot(asset, path)
            request = Request(OPERATIONS["snapshots.restore"], (content, nbytes))
            found: tuple[AssetInfo, bool] = self._caller.call(request)
            return found
        finally:
            with suppress(OSError):
                path.unlink()
