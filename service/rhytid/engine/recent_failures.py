"""What failed a moment ago, so that it is not tried again at once."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

from rhytid.errors import RhytidError

_REMEMBERED = 1000
# Until when it is remembered, and what it is made of.
_Failure = tuple[float, type[RhytidError], tuple[object, ...]]


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
