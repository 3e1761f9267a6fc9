"""Pushes again what could not be pushed because the shared store was away."""

from __future__ import annotations

import threading
from collections.abc import Callable

# Seconds after a failure.
PAUSE = 60.0


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
