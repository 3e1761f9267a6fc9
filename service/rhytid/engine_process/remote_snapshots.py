"""Snapshots of an engine in another process."""

from __future__ import annotations

import numpy as np

from rhytid.engine.messages import AssetInfo
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.requests import Request
from rhytid.storage.snapshots import PIECE, Readable, Snapshot


class RemoteSnapshots:
    """The calls of `SnapshotService`."""

    def __init__(self, supervisor: Caller) -> None:
        self._supervisor = supervisor

    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        # The process names the files of the store; this one reads them.
        return Snapshot(*self._supervisor.call(Request("snapshot", (asset,))))

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """As `SnapshotService.restore`."""
        content, filled = np.empty(nbytes, np.uint8), 0
        while filled < nbytes and (piece := stream.read(min(PIECE, nbytes - filled))):
            content[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
            filled += len(piece)
        request = Request("restore", (content[:filled], nbytes))
        found: tuple[AssetInfo, bool] = self._supervisor.call(request)
        return found
