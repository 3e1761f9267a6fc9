"""What failed a moment ago, so that it is not tried again at once."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

from rhytid.errors import RhytidError

_REMEMBERED = 1000


class RecentFailures:
    """Errors by key, for so many seconds each; a thousand at most."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._lock = seconds, threading.Lock()
        self._errors: OrderedDict[str, tuple[float, RhytidError]] = OrderedDict()

    def add(self, key: str, error: RhytidError) -> None:
        """Remember that this failed just now."""
        with self._lock:
            self._errors[key] = (time.monotonic() + self._seconds, error)
            self._errors.move_to_end(key)
            while len(self._errors) > _REMEMBERED:
                self._errors.popitem(last=False)

    def check(self, key: str) -> None:
        """Raise what it failed with, where it did a moment ago."""
        with self._lock:
            until, error = self._errors.get(key, (0.0, None))
            if error is None or time.monotonic() < until:
                found = error
            else:
                found = None
                del self._errors[key]
        if found is not None:
            # Another one: what is raised collects the frames of its callers.
            raise type(found)(*found.args)

    def forget(self, key: str) -> None:
        """It may be tried again."""
        with self._lock:
            self._errors.pop(key, None)
