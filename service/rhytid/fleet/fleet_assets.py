"""Assets, snapshots and packages of a fleet, as an ingress sees them."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from itertools import chain
from typing import BinaryIO

from rhytid.durable import reported
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset, Package
from rhytid.engine_process.remote_assets import RemoteAssets
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.remote_packages import RemotePackages
from rhytid.engine_process.remote_snapshots import RemoteSnapshots
from rhytid.engine_process.remote_tiles import RemoteTiles
from rhytid.engine_process.requests import Request
from rhytid.engine_process.upload_holds import UploadHolds
from rhytid.errors import NotFoundError, SharedDamageError, StorageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.shared_files import SharedFiles
from rhytid.storage.snapshot_index import BLOCK, LONGEST_INDEX, SnapshotIndex, index_size
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
        store: FleetStore,
    ) -> None:
        super().__init__(caller, frames, jobs, uploads, tiles)
        self._store = store
        # By id, the revision of the manifest that an asset was so with.
        self._known: dict[str, tuple[str, AssetInfo]] = {}

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
        """Every asset of the shared store but those that are known to be damaged. A ready asset is
        listed by its description there and not loaded. The list remembers each asset until its
        manifest changes."""
        revisions = self._store.assets.revisions()
        ids = sorted({*revisions, *self._store.files.uploads()})
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            listed = pool.map(lambda asset: self._found(asset, revisions.get(asset)), ids)
            found = [info for info in listed if info is not None]
        # A list: others may list meanwhile.
        self._known = {one: known for one, known in list(self._known.items()) if one in ids}
        return found

    def _found(self, asset: str, revision: str | None) -> AssetInfo | None:
        known = self._known.get(asset)
        if known is not None and known[0] == revision:
            return known[1]
        try:
            info = self._said(asset) if revision is not None else None
            info = info or self.info(asset)
        except NotFoundError:  # removed since
            return None
        except SharedDamageError as error:
            _log.error("asset %s is not listed: %s", asset, error)
            return None
        if info.state == "ready" and revision is not None:
            self._known[asset] = (revision, info)
        return info

    def _said(self, asset: str) -> AssetInfo | None:
        return self._store.files.info(asset, self._store.assets.digest(asset))


class GivenSnapshot(Snapshot):
    """A snapshot that is a file already, held open until it is closed.

    give_back: called then.
    """

    def __init__(self, file: BinaryIO, index: SnapshotIndex, give_back: Callable[[], None]) -> None:
        self.index, self.nbytes = index, index.nbytes
        self._file, self._give_back = file, give_back

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the file."""
        with reported("a snapshot cannot be read"):
            self._file.seek(0)
            while piece := self._file.read(PIECE):
                yield piece

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._give_back()


class FleetSnapshots(RemoteSnapshots):
    """The calls of `SnapshotService`, which go by way of the shared store."""

    def __init__(self, caller: FleetCaller, files: SharedFiles) -> None:
        super().__init__(caller)
        self._files = files

    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        name: str = self._supervisor.call(Request("snapshot", (asset,)))
        with reported("a snapshot cannot be read"), ExitStack() as stack:
            try:
                file = stack.enter_context(self._files.given(name))
            finally:
                self._remove(name)
            size = index_size(file.read(BLOCK))
            index = SnapshotIndex.decode(file.read(size))
            return GivenSnapshot(file, index, stack.pop_all().close)

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """As `SnapshotService.restore`."""
        pieces = iter(lambda: stream.read(PIECE), b"")
        head = _beginning(pieces)
        asset = asset_of(io.BytesIO(head))
        name = self._files.give(chain([head], pieces))
        try:
            request = Request("restore", (asset, name, nbytes))
            found: tuple[AssetInfo, bool] = self._supervisor.call(request)
            return found
        finally:
            self._remove(name)

    def _remove(self, name: str) -> None:
        with suppress(StorageError):  # it is swept a day later
            self._files.remove_given(name)


class FleetPackages(RemotePackages):
    """The calls of `PackageService`, whose files lie in the shared store."""

    def __init__(self, caller: FleetCaller, jobs: RemoteJobs, files: SharedFiles) -> None:
        super().__init__(caller, jobs)
        self._files = files

    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        """As `PackageService.of`."""
        found = super().of(asset, levels, key, begin)
        return self._files.package(found) if isinstance(found, Package) else found


def _beginning(pieces: Iterator[bytes]) -> bytes:
    """The first bytes of a snapshot, in which its index lies; all of a short one."""
    head = b""
    while len(head) < BLOCK + LONGEST_INDEX and (piece := next(pieces, b"")):
        head += piece
    return head
