"""Bytes that requests and jobs may hold at once: who asks for more than is free waits a while."""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from contextlib import suppress
from dataclasses import dataclass, field

from rhytid.errors import HostBusyError, HostMemoryError

# Seconds that a request waits for bytes before it is refused.
PATIENCE = 10.0


@dataclass(eq=False)
class _Waiting:
    hold: Hold
    nbytes: int
    granted: Future[None] = field(default_factory=Future)


class ByteBudget:
    """Counts bytes against a limit, by what they are held for. Safe from any thread.

    setting: the environment variable that sets the limit, for messages.  patience: seconds that
    one waits for bytes.
    """

    def __init__(self, limit: int, setting: str, patience: float = PATIENCE) -> None:
        self.limit, self.patience = limit, patience
        self._setting = setting
        self._lock = threading.Lock()
        self._by_purpose: Counter[str] = Counter()
        self._used = 0
        self._waiting: list[_Waiting] = []

    @property
    def used(self) -> int:
        """Bytes held now."""
        return self._used

    @property
    def waiting(self) -> int:
        """Who waits for bytes now."""
        return len(self._waiting)

    def used_for(self, purpose: str) -> int:
        """Bytes held now for one purpose."""
        return self._by_purpose[purpose]

    def hold(self, purpose: str) -> Hold:
        """Nothing yet; it grows."""
        return Hold(self, purpose)

    def ask(self, hold: Hold, more: int) -> _Waiting | None:
        """Give a hold `more` bytes at once, or else stand in line: what is answered is waited for.

        Raises HostMemoryError where they would not fit if nobody else held any.
        """
        with self._lock:
            if hold.nbytes + more > self.limit:
                raise HostMemoryError(
                    f"this takes {hold.nbytes + more} bytes: {self._setting} allows "
                    f"{self.limit} in all; ask for less at once, or send less"
                )
            if self._used + more <= self.limit:
                self._give(hold, more)
                return None
            waiting = _Waiting(hold, more)
            self._waiting.append(waiting)
            return waiting

    def give_up(self, waiting: _Waiting) -> None:
        """Leave the line; raises HostBusyError where the bytes did not come meanwhile."""
        with self._lock:
            if waiting not in self._waiting:
                return
            self._waiting.remove(waiting)
        raise HostBusyError(
            f"{self._used} of {self.limit} bytes are held by other requests ({self._setting}), "
            f"and {waiting.nbytes} more did not come free within {self.patience:g} seconds"
        )

    def give_back(self, hold: Hold, nbytes: int) -> None:
        """Take bytes from a hold, and give them to who waits: first come, first served, but who
        asks for little does not wait behind who asks for more than there is."""
        granted = []
        with self._lock:
            self._give(hold, -nbytes)
            for waiting in list(self._waiting):
                if self._used + waiting.nbytes <= self.limit:
                    self._give(waiting.hold, waiting.nbytes)
                    self._waiting.remove(waiting)
                    granted.append(waiting)
        for waiting in granted:
            waiting.granted.set_result(None)

    def _give(self, hold: Hold, more: int) -> None:
        hold.nbytes += more
        self._used += more
        self._by_purpose[hold.purpose] += more


class Hold:
    """What one request or job holds of a budget, until `release`. One thread at a time."""

    def __init__(self, budget: ByteBudget, purpose: str) -> None:
        self.nbytes, self.purpose = 0, purpose
        self._budget = budget

    def grow(self, more: int) -> None:
        """Hold `more` bytes, and wait for them where they are not free.

        Raises HostBusyError where they do not come free in time, HostMemoryError where they never
        would.
        """
        waiting = self._budget.ask(self, more)
        if waiting is not None:
            try:
                waiting.granted.result(self._budget.patience)
            except Late:
                self._budget.give_up(waiting)

    async def grow_async(self, more: int) -> None:
        """As `grow`; others run on the event loop meanwhile."""
        waiting = self._budget.ask(self, more)
        if waiting is None:
            return
        try:
            # The future is not cancelled with the wait: who grants it must be able to.
            await asyncio.wait_for(
                asyncio.shield(asyncio.wrap_future(waiting.granted)), self._budget.patience
            )
        except asyncio.TimeoutError:
            self._budget.give_up(waiting)
        except asyncio.CancelledError:
            with suppress(HostBusyError):
                self._budget.give_up(waiting)
            raise

    def resize(self, nbytes: int) -> None:
        """Hold so many bytes; waits as `grow` does where these are more than now."""
        if nbytes > self.nbytes:
            self.grow(nbytes - self.nbytes)
        else:
            self._budget.give_back(self, self.nbytes - nbytes)

    def release(self) -> None:
        """Give everything back; a second call does nothing."""
        self._budget.give_back(self, self.nbytes)
