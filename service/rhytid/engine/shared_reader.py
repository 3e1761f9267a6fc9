"""Asks a shared store for assets, and remembers for a moment what failed."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from rhytid.engine.jobs import Job
from rhytid.engine.recent_failures import RecentFailures
from rhytid.errors import (
    CancelledError,
    FetchingError,
    RhytidError,
    SharedDamageError,
    SharedStoreError,
)
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.unpacked import UnpackedAsset

# Seconds that what was not found is not looked for again, and that a caller waits for its turn.
FORGOTTEN, TURN = 2.0, 1.0
# How many assets are looked for at once: a store that does not answer shall not keep all threads of
# a server.
_AT_ONCE = 4
# Under which the failure of the whole store is remembered.
_STORE = ""


class SharedReader:
    """Looks for assets in a shared store and fetches them.

    mirror: the local store beside it.  damaged: ids of assets that were found damaged there.
    """

    def __init__(self, mirror: StoreMirror) -> None:
        self.mirror, self.damaged = mirror, set[str]()
        self._failures = RecentFailures(FORGOTTEN)
        self._turns = threading.Semaphore(_AT_ONCE)

    def look_for(self, id: str) -> None:
        """Raise NotFoundError where an asset is not there, and what `SharedStore.index` raises; the
        same again where it was asked a moment ago, and FetchingError where too many ask."""
        self.check()
        self._failures.check(id)
        if not self._turns.acquire(timeout=TURN):
            raise FetchingError(f"the shared store is asked for other assets before {id}")
        try:
            with self.noting(id):
                self.mirror.shared.index(id)
        finally:
            self._turns.release()

    @contextmanager
    def fetched(self, id: str, job: Job) -> Iterator[UnpackedAsset]:
        """As `StoreMirror.fetched`, for a job, which reports how far it is and may be cancelled."""
        self.check()
        report = partial(report_to, job, "fetching")
        with self.noting(id), self.mirror.fetched(id, report) as unpacked:
            yield unpacked

    def check(self) -> None:
        """Raise SharedStoreError where the store could not be used a moment ago."""
        self._failures.check(_STORE)

    def forget(self, id: str) -> None:
        """An asset may be looked for again."""
        self._failures.forget(id)

    @contextmanager
    def noting(self, id: str) -> Iterator[None]:
        """Remember what the block, which is about an asset, fails with."""
        try:
            yield
        except SharedStoreError as error:
            self._failures.add(_STORE, error)
            raise
        except RhytidError as error:
            if isinstance(error, SharedDamageError):
                self.damaged.add(id)
            if not isinstance(error, CancelledError):
                self._failures.add(id, error)
            raise


def report_to(job: Job, stage: str, share: float, file: str) -> None:
    """Report through a job how far a transfer is; raises CancelledError where it is cancelled."""
    job.progress(share, stage, file)
