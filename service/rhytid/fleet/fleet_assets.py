"""Assets, snapshots and packages of a fleet, as an ingress sees them."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any, BinaryIO

from rhytid.engine.messages import AssetInfo, JobInfo, Package
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import NotFoundError, SharedDamageError, StorageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.fleet_store import FleetStore
from rhytid.processes.envelope import Request
from rhytid.storage.snapshots import (
    BLOCK,
    LONGEST_INDEX,
    PIECE,
    Readable,
    Snapshot,
    SnapshotIndex,
    asset_of,
    index_size,
)
from rhytid.support.atomic_files import storage_errors

# Assets that are asked for at once when all are listed.
_AT_ONCE = 8
_log = logging.getLogger(__name__)


class SharedCalls:
    """Operations that an ingress does by itself, or by way of the shared store.

    own: these operations by name, as `RemoteCalls` takes them.
    """

    def __init__(self, caller: FleetCaller, store: FleetStore) -> None:
        self._caller, self._store, self._files = caller, store, store.files
        # By id, the revision of the manifest that an asset was so with.
        self._known: dict[str, tuple[str, AssetInfo]] = {}
        self.own: dict[str, Callable[..., Any]] = {
            "assets.all": self.all,
            "snapshots.of": self.snapshot,
            "snapshots.restore": self.restore,
            "packages.of": self.package,
        }

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
            info = info or self._asked("assets.info", asset)
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

    def snapshot(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        name: str = self._asked("snapshots.of", asset)
        with storage_errors("a snapshot cannot be read"), ExitStack() as stack:
            try:
                file = stack.enter_context(self._files.given(name))
            finally:
                self._remove(name)
            size = index_size(file.read(BLOCK))
            index = SnapshotIndex.decode(file.read(size))
            return GivenSnapshot(file, index, stack.pop_all().close)

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """The asset of a snapshot of so many bytes, and whether it is new."""
        pieces = iter(lambda: stream.read(PIECE), b"")
        head = _beginning(pieces)
        asset = asset_of(io.BytesIO(head))
        name = self._files.give(chain([head], pieces))
        try:
            found: tuple[AssetInfo, bool]
            found = self._asked("snapshots.restore", GivenName(asset, name), nbytes)
            return found
        finally:
            self._remove(name)

    def package(self, *arguments: Any, **named: Any) -> Package | JobInfo | None:
        """The package of an asset, whose file lies in the shared store, or the job that makes
        it."""
        found = self._asked("packages.of", *arguments, **named)
        return self._files.package(found) if isinstance(found, Package) else found

    def _asked(self, operation: str, *arguments: Any, **named: Any) -> Any:
        return self._caller.call(Request(OPERATIONS[operation], arguments, named))

    def _remove(self, name: str) -> None:
        with suppress(StorageError):  # it is swept a day later
            self._files.remove_given(name)


@dataclass(frozen=True)
class GivenName:
    """A snapshot in the shared store, in place of its bytes.  asset: the one that it is of."""

    asset: str
    name: str


class GivenSnapshot(Snapshot):
    """A snapshot that is a file already, held open until it is closed.

    give_back: called then.
    """

    def __init__(self, file: BinaryIO, index: SnapshotIndex, give_back: Callable[[], None]) -> None:
        self.index, self.nbytes = index, index.nbytes
        self._file, self._give_back = file, give_back

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the file."""
        with storage_errors("a snapshot cannot be read"):
            self._file.seek(0)
            while piece := self._file.read(PIECE):
                yield piece

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._give_back()


def _beginning(pieces: Iterator[bytes]) -> bytes:
    """The first bytes of a snapshot, in which its index lies; all of a short one."""
    head = b""
    while len(head) < BLOCK + LONGEST_INDEX and (piece := next(pieces, b"")):
        head += piece
    return head
