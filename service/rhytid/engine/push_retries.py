"""Pushes again what could not be pushed because the shared store was away."""

from __future__ import annotations

import threading
from collections.abc import Callable

# Seconds after a failure.
PAUSE = 60.0


class PushRetries:
    """Ids of assets that wait to be pushed again.  push: begins to push one."""

    def __init__(self, push: Callable[[str], object]) -> None:
        self._push, self._lock = push, threading.Lock()
        self._waiting: set[str] = set()
        self._timer: threading.Timer | None = None
        self._closed = False

    def add(self, id: str) -> None:
        """Push an asset again after a pause."""
        with self._lock:
            self._waiting.add(id)
            if self._timer is None and not self._closed:
                self._timer = threading.Timer(PAUSE, self._again)
                self._timer.daemon = True
                self._timer.start()

    def close(self) -> None:
        """Push nothing more."""
        with self._lock:
            self._closed = True
            if self._timer is not None:
                self._timer.cancel()

    def _again(self) -> None:
        with self._lock:
            ids, self._waiting, self._timer = self._waiting, set(), None
            if self._closed:
                return
        for id in ids:
            self._push(id)
