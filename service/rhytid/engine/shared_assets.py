"""Assets of a store that several machines share: pushed once they are built, fetched when they are
first used."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from functools import partial

from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.assets import Asset
from rhytid.engine.jobs import Job, Jobs
from rhytid.engine.local_room import LocalRoom
from rhytid.engine.push_retries import PushRetries
from rhytid.engine.restored_assets import RestoredAssets
from rhytid.engine.shared_reader import SharedReader, report_to
from rhytid.errors import (
    CancelledError,
    FetchingError,
    NotFoundError,
    QueryError,
    SharedDamageError,
    SharedStoreError,
    StorageError,
    StoreFormatError,
)
from rhytid.storage.homes import ID
from rhytid.storage.shared.mirror import StoreMirror

# Seconds that a caller waits for an asset before it is told to ask again, and that a removal waits
# for a transfer to end.
PATIENCE, _ENDING = 1.0, 10.0
_log = logging.getLogger(__name__)


@dataclass
class _Fetch:
    """The job that fetches an asset, and what it failed with."""

    job: Job
    error: BaseException | None = None


class SharedAssets:
    """Pushes assets to a shared store and fetches them from it.

    mirror: the local store beside the shared one; None: there is none, nothing is pushed and
    nothing is found.  room: what keeps the local store below a limit, if there is one.
    """

    def __init__(
        self,
        mirror: StoreMirror | None,
        registry: AssetRegistry,
        restored: RestoredAssets,
        jobs: Jobs,
        room: LocalRoom | None = None,
    ) -> None:
        self._reader = None if mirror is None else SharedReader(mirror)
        self._assets, self._restored = registry, restored
        self._jobs, self._room = jobs, room
        self._lock = threading.Lock()
        self._fetches: dict[str, _Fetch] = {}
        self._retries = PushRetries(self.push)

    def open(self) -> None:
        """Push what the shared store was not given before; a shared store that cannot be reached is
        logged."""
        if self._reader is None:
            return
        mirror = self._reader.mirror
        try:
            mirror.shared.check()
        except SharedStoreError as error:
            _log.error("%s", error)
        for asset in self._assets.all():
            if asset.state == "ready" and not _is_pushed(mirror, asset.id):
                self.push(asset.id)

    def close(self) -> None:
        """Begin nothing more."""
        self._retries.close()

    def push(self, id: str) -> Job | None:
        """Write a ready asset to the shared store, as a job; None where there is no such store."""
        if self._reader is None:
            return None
        return self._jobs.start("push", id, partial(self._push, self._reader, id), always=True)

    def get(self, id: str) -> Asset:
        """An asset that was not here, fetched from the shared store.

        Raises NotFoundError where that does not have it, FetchingError where it takes longer than a
        second, BusyError where too many jobs wait, and what the shared store raises.
        """
        return self._get(id, PATIENCE)

    def bring(self, id: str) -> Asset:
        """As `get`, and waits for as long as it takes."""
        return self._get(id, None)

    def take(self, job: Job, asset: Asset) -> bool:
        """Make an asset that is to be built ready by fetching it; False where that is not possible,
        and it has to be built. Raises CancelledError where the job is cancelled."""
        if self._reader is None:
            return False
        try:
            with self._reader.fetched(asset.id, job) as unpacked, asset.kept():
                whole = self._reader.mirror.take(unpacked)
                self._restored.fill(asset, unpacked)
        except NotFoundError:
            self._reader.forget(asset.id)  # it will be there soon
            return False
        except (SharedStoreError, SharedDamageError, StoreFormatError) as error:
            _log.error("asset %s is built: %s", asset.id, error)
            return False
        if not whole:
            self.push(asset.id)
        return True

    def remove(self, id: str) -> None:
        """Remove an asset from the shared store; raises NotFoundError where it is not there, and
        QueryError where there is no such store."""
        if self._reader is None:
            raise QueryError("shared: this server has no shared store (RHYTID_SHARED_STORE)")
        for job in self._jobs.of(id):
            if job.info.kind in ("push", "fetch"):
                job.cancel()
                job.wait(_ENDING)
        self._reader.mirror.shared.remove(id)

    def _push(self, reader: SharedReader, id: str, job: Job) -> None:
        report = partial(report_to, job, "pushing")
        try:
            reader.check()
            with reader.noting(id):
                reader.mirror.push(id, report, anew=id in reader.damaged)
        except SharedStoreError:
            self._retries.add(id)
            raise
        reader.damaged.discard(id)
        reader.forget(id)
        self._make_room()

    def _get(self, id: str, patience: float | None) -> Asset:
        if self._reader is None or not ID.fullmatch(id):
            raise NotFoundError(f"no asset {id!r}")
        fetch = self._fetch_of(self._reader, id)
        if not fetch.job.wait(patience):
            raise FetchingError(
                f"asset {id} is being fetched from the shared store (job {fetch.job.info.id})"
            )
        if (found := self._assets.find(id)) is not None:
            return found
        error = fetch.error or CancelledError(f"fetching asset {id} was cancelled")
        raise type(error)(*error.args)

    def _fetch_of(self, reader: SharedReader, id: str) -> _Fetch:
        """The job that fetches an asset: one that does already, or a new one."""
        with self._lock:
            if (known := self._fetches.get(id)) is not None:
                return known
        reader.look_for(id)
        with self._lock:
            if (known := self._fetches.get(id)) is not None:
                return known
            begun = threading.Event()
            job = self._jobs.start("fetch", id, partial(self._fetch, reader, id, begun))
            fetch = self._fetches[id] = _Fetch(job)
            begun.set()
        job.when_ended(partial(self._ended, id))
        return fetch

    def _ended(self, id: str) -> None:
        self._fetches.pop(id, None)

    def _fetch(self, reader: SharedReader, id: str, begun: threading.Event, job: Job) -> None:
        begun.wait()
        fetch = self._fetches[id]
        try:
            with reader.fetched(id, job) as unpacked:
                self._restored.register(unpacked, reader.mirror.take)
            self._make_room()
        except BaseException as error:
            fetch.error = error
            raise

    def _make_room(self) -> None:
        if self._room is not None:
            self._room.make()


def _is_pushed(mirror: StoreMirror, id: str) -> bool:
    """As `StoreMirror.is_pushed`; true of what cannot be read, which is logged."""
    try:
        return mirror.is_pushed(id)
    except (StorageError, NotFoundError) as error:
        _log.error("asset %s is not pushed: %s", id, error)
        return True
