"""Calls of a shared store, which are not made where they failed a moment ago."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager

from rhytid.errors import (
    CancelledError,
    FetchingError,
    RhytidError,
    SharedDamageError,
    SharedStoreError,
)
from rhytid.storage.asset_snapshots import UnpackedAsset
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import Report

# Seconds that what was not found is not looked for again, and that a caller waits for its turn.
FORGOTTEN, TURN = 2.0, 1.0
# How many assets are looked for at once, and how many are removed: a store that does not answer
# shall not keep all threads of a server.
_AT_ONCE = 4
# Under which the failure of the whole store is remembered.
_STORE = ""
# Failures that are remembered.
_REMEMBERED = 1000
# Until when it is remembered, and what it is made of.
_Failure = tuple[float, type[RhytidError], tuple[object, ...]]


class SharedCalls:
    """Calls of a shared store, by many threads.

    mirror: the local store beside it.
    """

    def __init__(self, mirror: StoreMirror) -> None:
        self.mirror = mirror
        # Assets that were found damaged there, by id.
        self._damaged: set[str] = set()
        self._failures = RecentFailures(FORGOTTEN)
        # Apart: a removal of many objects takes long.
        self._looking, self._removing = (threading.Semaphore(_AT_ONCE) for _ in range(2))

    def look_for(self, id: str) -> None:
        """Raise NotFoundError where an asset is not there, and what `SharedStore.index` raises; the
        same again where it was asked a moment ago, and FetchingError where too many ask."""
        self.check()
        self._failures.check(id)
        with _turn(self._looking, id), self._noting(id):
            self.mirror.shared.index(id)

    def remove(self, id: str) -> None:
        """Remove an asset there; raises what `SharedStore.remove` does, and FetchingError where too
        many ask."""
        self.check()
        with _turn(self._removing, id), self.watching(id):
            self.mirror.shared.remove(id)

    def push(self, id: str, report: Report) -> None:
        """As `StoreMirror.push`; what was found damaged there is written anew."""
        with self.watching(id):
            self.mirror.push(id, report, anew=id in self._damaged)
        self._damaged.discard(id)
        self._failures.forget(id)

    @contextmanager
    def fetched(self, id: str, report: Report) -> Iterator[UnpackedAsset]:
        """As `StoreMirror.fetched`."""
        with self._noting(id), self.mirror.fetched(id, report) as unpacked:
            yield unpacked

    def check(self) -> None:
        """Raise SharedStoreError where the store could not be used a moment ago."""
        self._failures.check(_STORE)

    def forget(self, id: str) -> None:
        """An asset may be looked for again."""
        self._failures.forget(id)

    @contextmanager
    def _noting(self, id: str) -> Iterator[None]:
        """Remember what the block fails with that looks for an asset, or fetches it."""
        try:
            with self.watching(id):
                yield
        except (SharedStoreError, CancelledError):
            raise  # of the whole store, or of nothing
        except RhytidError as error:
            self._failures.add(id, error)
            raise

    @contextmanager
    def watching(self, id: str) -> Iterator[None]:
        """Remember where the block finds that the store is away, or an asset damaged in it. Raises
        what `check` does before."""
        self.check()
        try:
            yield
        except SharedStoreError as error:
            self._failures.add(_STORE, error)
            raise
        except SharedDamageError:
            self._damaged.add(id)
            raise


@contextmanager
def _turn(turns: threading.Semaphore, id: str) -> Iterator[None]:
    if not turns.acquire(timeout=TURN):
        raise FetchingError(f"the shared store is asked for other assets before {id}")
    try:
        yield
    finally:
        turns.release()


class RecentFailures:
    """Errors by key, for so many seconds each; a thousand at most."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._lock = seconds, threading.Lock()
        self._errors: OrderedDict[str, _Failure] = OrderedDict()

    def add(self, key: str, error: RhytidError) -> None:
        """Remember that this failed just now."""
        with self._lock:
            # Not the error: its frames would keep what was being read, an asset for one.
            self._errors[key] = (time.monotonic() + self._seconds, type(error), error.args)
            self._errors.move_to_end(key)
            while len(self._errors) > _REMEMBERED:
                self._errors.popitem(last=False)

    def check(self, key: str) -> None:
        """Raise what it failed with, where it did a moment ago."""
        with self._lock:
            until, kind, about = self._errors.get(key, (0.0, RhytidError, ()))
            if time.monotonic() >= until:
                self._errors.pop(key, None)
                return
        raise kind(*about)

    def forget(self, key: str) -> None:
        """It may be tried again."""
        with self._lock:
            self._errors.pop(key, None)
