"""How many of something callers may have open at once, in all and each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from rhytid.errors import BusyError, QuotaError


class CallerPlaces:
    """Counts what callers have open. For one thread.

    most, most_each: in all, and of one caller.  full, full_each: what is said beyond them, with
    {count}, and {caller} in the second.
    """

    def __init__(self, most: int, most_each: int, full: str, full_each: str) -> None:
        self._most, self._most_each = most, most_each
        self._full, self._full_each = full, full_each
        self._open: Counter[str] = Counter()

    @contextmanager
    def one(self, caller: str) -> Iterator[None]:
        """A place within the block; raises QuotaError and BusyError naming the limit."""
        if self._open[caller] >= self._most_each:
            raise QuotaError(self._full_each.format(caller=caller, count=self._most_each), 1)
        if self._open.total() >= self._most:
            raise BusyError(self._full.format(count=self._most))
        self._open[caller] += 1
        try:
            yield
        finally:
            self._open[caller] -= 1
            if not self._open[caller]:
                del self._open[caller]

    def __len__(self) -> int:
        return self._open.total()
