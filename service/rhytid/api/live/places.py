"""How many live connections there may be at once, in all and of one caller."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from rhytid.errors import BusyError, QuotaError

MOST, MOST_EACH = 64, 16


class LivePlaces:
    """Counts connections. For one thread."""

    def __init__(self, most: int = MOST, most_each: int = MOST_EACH) -> None:
        self._most, self._most_each = most, most_each
        self._open: Counter[str] = Counter()

    @contextmanager
    def one(self, caller: str) -> Iterator[None]:
        """A place within the block; raises QuotaError and BusyError naming the limit."""
        if self._open[caller] >= self._most_each:
            raise QuotaError(f"{caller} has {self._most_each} live connections open already", 1)
        if self._open.total() >= self._most:
            raise BusyError(f"{self._most} live connections are open already")
        self._open[caller] += 1
        try:
            yield
        finally:
            self._open[caller] -= 1
            if not self._open[caller]:
                del self._open[caller]

    def __len__(self) -> int:
        return self._open.total()
