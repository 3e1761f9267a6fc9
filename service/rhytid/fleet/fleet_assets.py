"""Assets and snapshots of a fleet, as an ingress sees them."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

from rhytid.durable import reported
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import AssetInfo, NewAsset
from rhytid.engine_process.remote_assets import RemoteAssets
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.remote_snapshots import RemoteSnapshots
from rhytid.engine_process.remote_tiles import RemoteTiles
from rhytid.engine_process.requests import Request
from rhytid.engine_process.upload_holds import UploadHolds
from rhytid.errors import NotFoundError, SharedDamageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.shared_folder import Revisions, SharedFolder
from rhytid.storage.snapshot_index import BLOCK, SnapshotIndex, index_size
from rhytid.storage.snapshots import PIECE, Readable, Snapshot, asset_of

# Assets that are asked for at once when all are listed.
_AT_ONCE = 8
_log = logging.getLogger(__name__)


class FleetAssets(RemoteAssets):
    """The calls of `AssetService`."""

    def __init__(
        self,
        caller: FleetCaller,
        frames: FrameVersions,
        jobs: RemoteJobs,
        uploads: UploadHolds,
        tiles: RemoteTiles,
        shared: SharedFolder,
    ) -> None:
        super().__init__(caller, frames, jobs, uploads, tiles)
        self._shared = shared
        self._known: dict[str, tuple[Revisions, AssetInfo]] = {}

    def create(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        """As `AssetService.create`; the replica has the frames when this returns."""
        named = {"strict": strict, "allow": tuple(allow)}
        info: AssetInfo = self._supervisor.call(Request("create", (new,), named))
        return self._noted(info)

    def all(self) -> list[AssetInfo]:
        """Every asset of the shared folder but those that are known to be damaged. What is said of
        a ready one there is taken: it is not loaded. What was found is kept."""
        ids = self._shared.ids()
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            found = [info for info in pool.map(self._found, ids) if info is not None]
        # A list: others may list meanwhile.
        self._known = {one: known for one, known in list(self._known.items()) if one in ids}
        return found

    def _found(self, asset: str) -> AssetInfo | None:
        now = (self._shared.revision(asset), self._shared.settings_revision(asset))
        known = self._known.get(asset)
        if known is not None and known[0] == now:
            return known[1]
        try:
            info = self._shared.info(asset, now) or self.info(asset)
        except NotFoundError:  # removed since
            return None
        except SharedDamageError as error:
            _log.error("asset %s is not listed: %s", asset, error)
            return None
        if info.state == "ready" and now[0] is not None:
            self._known[asset] = (now, info)
        return info


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
