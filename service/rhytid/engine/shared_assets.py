"""Assets of a store that several machines share: pushed once they are built, fetched when they are
first used."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.stored import RestoredAssets
from rhytid.engine.frames import LEFT
from rhytid.engine.job import Job
from rhytid.engine.jobs import TRANSFERS, Jobs
from rhytid.engine.local_copies import LocalCopies
from rhytid.engine.shared_calls import SharedCalls
from rhytid.errors import (
    CancelledError,
    DiskFullError,
    FetchingError,
    NotFoundError,
    QueryError,
    SharedDamageError,
    SharedStoreError,
    StorageError,
    StoreFormatError,
    TooManyFilesError,
)
from rhytid.storage.homes import ID
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import Report
from rhytid.support import cancellation

# Seconds that a caller waits for an asset before it is told to ask again, and that a removal waits
# for a transfer to end.
PATIENCE, _ENDING = 1.0, 10.0
# The same for a caller where machines go in step, and seconds between two looks whether it still
# waits.
_IN_STEP, _LOOK = 60.0, 0.5
# Seconds after which a push that failed is tried again.
PAUSE = 60.0
# What may have passed when a push is tried again.
_PASSING = (SharedStoreError, DiskFullError, TooManyFilesError)
_log = logging.getLogger(__name__)


@dataclass
class _Transfer:
    """The job that fetches or pushes an asset, the error that it failed with, and the newer push
    that was begun in its place, if one was."""

    job: Job = field(init=False)
    error: BaseException | None = None
    newer: _Transfer | None = None

    @contextmanager
    def failing(self) -> Iterator[None]:
        """The block is the work of the job."""
        try:
            yield
        except BaseException as error:
            self.error = error
            raise

    def check(self) -> None:
        """Raise what the job failed with, if it did; not that itself, which holds what was read."""
        if self.error is not None:
            raise type(self.error)(*self.error.args)


class SharedAssets:
    """Pushes assets to a shared store and fetches them from it.

    mirror: the local store beside the shared one; None: there is none, nothing is pushed and
    nothing is found.  copies: what is dropped of the local store; None as the mirror.
    in_step: `ServiceSettings.in_step`.
    """

    def __init__(
        self,
        mirror: StoreMirror | None,
        registry: AssetRegistry,
        restored: RestoredAssets,
        jobs: Jobs,
        copies: LocalCopies | None = None,
        *,
        in_step: bool = False,
    ) -> None:
        self._calls = None if mirror is None else SharedCalls(mirror)
        self._assets, self._restored = registry, restored
        self._jobs, self._copies, self._in_step = jobs, copies, in_step
        self._lock = threading.Lock()
        self._fetches: dict[str, _Transfer] = {}
        self._pushes: dict[str, _Transfer] = {}
        self._retries = PushRetries(self.push)

    def open(self) -> None:
        """Push what the shared store was not given before; where that cannot be used, it is logged,
        and they are pushed later. Raises StoreFormatError where a newer release made it."""
        if self._calls is None:
            return
        mirror, push = self._calls.mirror, self.push
        try:
            mirror.shared.check()
        except StoreFormatError:
            raise
        except StorageError as error:
            _log.error("%s", error)
            push = self._retries.add
        for asset in self._assets.all():
            if asset.state == "ready" and not _is_pushed(mirror, asset.id):
                push(asset.id)

    def close(self) -> None:
        """Begin nothing more."""
        self._retries.close()

    def push(self, id: str) -> Job | None:
        """Write a ready asset to the shared store, as a job; None where there is no such store."""
        return None if self._calls is None else self._pushing(self._calls, id).job

    def share(self, id: str) -> None:
        """Push a ready asset. Where machines go in step, wait until the shared store has it; raises
        what the push fails with then."""
        if self._calls is None:
            return
        pushing: _Transfer | None = self._pushing(self._calls, id)
        while self._in_step and pushing is not None:
            while not pushing.job.wait(_LOOK):
                cancellation.check()
            pushing.check()
            with self._lock:  # one that waits is cancelled for a newer one, which does the same
                pushing = pushing.newer if pushing.job.info.state == "cancelled" else None

    def get(self, id: str) -> Asset:
        """An asset that was not here, fetched from the shared store.

        Raises NotFoundError where that does not have it, FetchingError where it takes longer than a
        second, BusyError where too many jobs wait, and what the shared store raises.
        """
        if self._calls is None or not ID.fullmatch(id):
            raise NotFoundError(f"no asset {id!r}")
        fetch = self._fetch_of(self._calls, id)
        if not fetch.job.wait(_IN_STEP if self._in_step else PATIENCE):
            raise FetchingError(
                f"asset {id} is being fetched from the shared store (job {fetch.job.info.id})"
            )
        if (found := self._assets.find(id)) is not None:
            return found
        if fetch.job.info.state == "done":
            raise FetchingError(LEFT)
        fetch.check()
        raise CancelledError(f"fetching asset {id} was cancelled")

    def look_anew(self, id: str) -> None:
        """Forget that an asset was not found in the shared store, or was damaged there."""
        if self._calls is not None:
            self._calls.forget(id)

    def follow(self, asset: Asset, use: Callable[[AssetSettings], None], *, replace: bool) -> bool:
        """Give a ready asset, whose lock is held, what another machine has changed of it in the
        shared store: its settings, by `use`. Where another file differs it is taken out, to be
        fetched anew; False, and nothing is done, where that is not wanted (`replace`).

        Raises NotFoundError where the asset was removed there, and what the shared store raises.
        """
        if self._calls is None or self._copies is None:
            return True
        mirror = self._calls.mirror
        with self._calls.watching(asset.id):
            there = mirror.newer(asset.id)
            if there is None:
                return True
            found = mirror.newer_settings(there)
        if found is not None:
            use(found[0])
            mirror.take_settings(there, found[1])
        elif replace:
            self._jobs.cancel_all(asset.id)
            self._copies.take_out(asset)
        return found is not None or replace

    def leave(self, asset: Asset) -> bool:
        """As `LocalCopies.leave`, with its frames; never where there is no shared store."""
        return self._copies is not None and self._copies.leave(asset, with_frames=True)

    def manifest(self, id: str) -> str:
        """As `StoreMirror.digest`; empty where there is no shared store."""
        return "" if self._calls is None else self._calls.mirror.digest(id)

    def take(self, job: Job, asset: Asset) -> bool:
        """Make an asset that is to be built ready by fetching it; False where that is not possible,
        and it has to be built. Raises CancelledError where the job is cancelled."""
        if self._calls is None:
            return False
        try:
            with self._calls.fetched(asset.id, _report(job, "fetching")) as unpacked, asset.kept():
                whole = self._calls.mirror.take(unpacked)
                self._restored.fill(asset, unpacked)
        except NotFoundError:
            self._calls.forget(asset.id)  # it will be there soon
            return False
        except (SharedStoreError, SharedDamageError, StoreFormatError) as error:
            _log.error("asset %s is built: %s", asset.id, error)
            return False
        if not whole or (self._copies is not None and self._copies.limit is not None):
            self.push(asset.id)  # which makes room, too, where builds do not wait for it
        return True

    def remove(self, id: str) -> None:
        """Remove an asset from the shared store; raises NotFoundError where it is not there,
        QueryError where there is no such store, and FetchingError where too many ask it."""
        if self._calls is None:
            raise QueryError("shared: this server has no shared store (RHYTID_SHARED_STORE)")
        for job in self._jobs.of(id):
            if job.info.kind in TRANSFERS:
                job.cancel()
                job.wait(_ENDING)
        self._calls.remove(id)

    def _pushing(self, calls: SharedCalls, id: str) -> _Transfer:
        pushing = _Transfer()
        work = partial(self._push, calls, id, pushing)
        with self._lock:
            before, self._pushes[id] = self._pushes.get(id), pushing
            if before is not None:
                before.newer = pushing
            pushing.job = self._jobs.start("push", id, work, always=True)
        pushing.job.when_ended(partial(self._push_ended, id, pushing))
        return pushing

    def _push_ended(self, id: str, pushing: _Transfer) -> None:
        # Without the lock, which the thread has that cancels a push for a newer one.
        if self._pushes.get(id) is pushing:
            self._pushes.pop(id, None)

    def _push(self, calls: SharedCalls, id: str, pushing: _Transfer, job: Job) -> None:
        with pushing.failing():
            try:
                calls.push(id, _report(job, "pushing"))
            except _PASSING:
                self._retries.add(id)
                raise
            except NotFoundError as error:
                raise CancelledError(f"asset {id} was removed") from error
        self._retries.went_well()
        self._make_room()

    def _fetch_of(self, calls: SharedCalls, id: str) -> _Transfer:
        """The job that fetches an asset: one that does already, or a new one."""
        with self._lock:
            if (known := self._fetches.get(id)) is not None:
                return known
        calls.look_for(id)
        with self._lock:
            if (known := self._fetches.get(id)) is not None:
                return known
            fetch = _Transfer()
            fetch.job = self._jobs.start("fetch", id, partial(self._fetch, calls, id, fetch))
            self._fetches[id] = fetch
        fetch.job.when_ended(lambda: self._ended(id))
        return fetch

    def _ended(self, id: str) -> None:
        self._fetches.pop(id, None)

    def _fetch(self, calls: SharedCalls, id: str, fetch: _Transfer, job: Job) -> None:
        with fetch.failing():
            with calls.fetched(id, _report(job, "fetching")) as unpacked:
                self._restored.register(unpacked, calls.mirror.take)
            self._make_room()

    def _make_room(self) -> None:
        if self._copies is not None:
            self._copies.make_room()


def _is_pushed(mirror: StoreMirror, id: str) -> bool:
    """As `StoreMirror.is_pushed`; true of what cannot be read, which is logged."""
    try:
        return mirror.is_pushed(id)
    except (StorageError, NotFoundError) as error:
        _log.error("asset %s is not pushed: %s", id, error)
        return True


def _report(job: Job, stage: str) -> Report:
    """Tells a job how far a transfer is; raises CancelledError where it is cancelled."""
    return lambda share, file: job.progress(share, stage, file)


class PushRetries:
    """Assets that wait to be pushed again, by id.  push: begins to push one.

    After a pause one of them is tried; once a push went well, the others follow. So a shared store
    that is away for long is asked once in a pause, whatever waits for it.
    """

    def __init__(self, push: Callable[[str], object]) -> None:
        self._push, self._lock = push, threading.Lock()
        # In the order in which they came.
        self._waiting: dict[str, None] = {}
        self._timer: threading.Timer | None = None
        self._closed = False

    def add(self, id: str) -> None:
        """Push an asset again after a pause."""
        with self._lock:
            self._waiting[id] = None
            self._wait()

    def went_well(self) -> None:
        """A push did: begin those that wait."""
        with self._lock:
            ids, self._waiting = self._waiting, {}
            if self._closed:
                return
        for id in ids:
            self._push(id)

    def close(self) -> None:
        """Push nothing more."""
        with self._lock:
            self._closed = True
            if self._timer is not None:
                self._timer.cancel()

    def _wait(self) -> None:
        if self._timer is None and not self._closed:
            self._timer = threading.Timer(PAUSE, self._again)
            self._timer.daemon = True
            self._timer.start()

    def _again(self) -> None:
        with self._lock:
            self._timer = None
            if self._closed or not self._waiting:
                return
            id = next(iter(self._waiting))
            del self._waiting[id]
            if self._waiting:
                self._wait()  # this one may be gone, and tell nothing of the store
        self._push(id)
