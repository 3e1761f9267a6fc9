"""Bytes that requests and jobs may hold at once; a request for more bytes than are free waits a
while."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import takewhile

from rhytid.errors import HostBusyError, HostMemoryError
from rhytid.support import cancellation

# Seconds that a request waits for bytes before it is refused.
PATIENCE = 10.0
# Seconds between two looks at whether it is still to wait.
_LOOK = 0.1


@dataclass(eq=False)
class _Waiting:
    """A request in the queue."""

    hold: Hold
    nbytes: int
    granted: Future[None] = field(default_factory=Future)


class ByteBudget:
    """Counts bytes against a limit, by the purpose that they are held for. Safe from any thread.

    setting: the environment variable that sets the limit, for messages.  patience: seconds that a
    request waits for bytes.  on_shortage: called when a request begins to wait, by its thread, to
    give back what can be made again.
    """

    def __init__(self, limit: int, setting: str, patience: float = PATIENCE) -> None:
        self.limit, self.patience = limit, patience
        self._setting = setting
        self._lock = threading.Lock()
        self._by_purpose: Counter[str] = Counter()
        self._used = 0
        self._waiting: list[_Waiting] = []
        self.on_shortage: Callable[[], None] = lambda: None

    @property
    def used(self) -> int:
        """Bytes held now."""
        return self._used

    @property
    def waiting(self) -> int:
        """How many requests wait for bytes now."""
        return len(self._waiting)

    def used_for(self, purpose: str) -> int:
        """Bytes held now for a purpose."""
        return self._by_purpose[purpose]

    def hold(self, purpose: str) -> Hold:
        """A new hold of 0 bytes."""
        return Hold(self, purpose)

    def taken(self, purpose: str, nbytes: int) -> Hold | None:
        """A new hold of `nbytes` bytes; None where they are not free now, or somebody waits."""
        with self._lock:
            if self._waiting or not self._fits(nbytes):
                return None
            hold = Hold(self, purpose)
            self._give(hold, nbytes)
        return hold

    def has(self, nbytes: int) -> bool:
        """Whether `nbytes` bytes are free now, and nobody waits for any."""
        return self._fits(nbytes) and not self._waiting

    def ask(self, hold: Hold, more: int) -> _Waiting | None:
        """Give a hold `more` bytes at once, or put it in the queue and return its place there.

        Raises HostMemoryError where the bytes would not fit even if no other hold had any.
        """
        with self._lock:
            if hold.nbytes + more > self.limit:
                raise HostMemoryError(
                    f"this takes {hold.nbytes + more} bytes: {self._setting} allows "
                    f"{self.limit} in all; ask for less at once, or send less"
                )
            # Waiting requests are served before new ones, so a large one is not overtaken for ever.
            if self._fits(more) and (hold.nbytes or not more or not self._waiting):
                self._give(hold, more)
                return None
            waiting = _Waiting(hold, more)
            self._waiting.append(waiting)
            return waiting

    def give_up(self, waiting: _Waiting) -> None:
        """Leave the queue; raises HostBusyError where the bytes have not come by now."""
        with self._lock:
            if waiting not in self._waiting:
                return
            self._waiting.remove(waiting)
            used, served = self._used, self._serve()
        _wake(served)
        raise HostBusyError(
            f"{used} of {self.limit} bytes are held by other requests ({self._setting}), "
            f"and {waiting.nbytes} more did not come free within {self.patience:g} seconds"
        )

    def give_back(self, hold: Hold, nbytes: int) -> None:
        """Take bytes from a hold and serve the requests that wait, first come, first served.

        Holds that have bytes already and need more are served before those that have none, in any
        order that fits: other requests wait for these bytes, and for their holders to end.
        """
        with self._lock:
            self._give(hold, -nbytes)
            served = self._serve()
        _wake(served)

    def split(self, hold: Hold, nbytes: int, purpose: str) -> Hold:
        """A new hold with `nbytes` of the bytes of `hold`, at most all of them; it never waits."""
        with self._lock:
            part, moved = Hold(self, purpose), min(nbytes, hold.nbytes)
            self._give(hold, -moved)
            self._give(part, moved)
        return part

    def _serve(self) -> list[_Waiting]:
        """Give bytes to those that wait and take them out of the queue."""
        growing = [waiting for waiting in self._waiting if waiting.hold.nbytes]
        new = [waiting for waiting in self._waiting if not waiting.hold.nbytes]
        served = [waiting for waiting in growing if self._try(waiting)]
        if len(served) == len(growing):
            served += takewhile(self._try, new)
        self._waiting = [waiting for waiting in self._waiting if waiting not in served]
        return served

    def _try(self, waiting: _Waiting) -> bool:
        fits = self._fits(waiting.nbytes)
        if fits:
            self._give(waiting.hold, waiting.nbytes)
        return fits

    def _fits(self, more: int) -> bool:
        return self._used + more <= self.limit

    def _give(self, hold: Hold, more: int) -> None:
        hold.nbytes += more
        self._used += more
        self._by_purpose[hold.purpose] += more


class Hold:
    """The bytes that one request or job holds of a budget, until `release`. For one thread at a
    time."""

    def __init__(self, budget: ByteBudget, purpose: str) -> None:
        self.nbytes, self.purpose = 0, purpose
        self._budget = budget

    @property
    def limit(self) -> int:
        """The most that it can ever hold: the limit of its budget."""
        return self._budget.limit

    def grow(self, more: int) -> None:
        """Hold `more` bytes, and wait for them where they are not free.

        Raises HostBusyError where they do not come free in time, HostMemoryError where they never
        would, and the error that the work of this thread is to stop with.
        """
        waiting = self._budget.ask(self, more)
        if waiting is None:
            return
        self._budget.on_shortage()
        until = time.monotonic() + self._budget.patience
        while not wait([waiting.granted], min(_LOOK, self._budget.patience)).done:
            if time.monotonic() >= until:
                return self._budget.give_up(waiting)
            try:
                cancellation.check()
            except BaseException:
                with suppress(HostBusyError):
                    self._budget.give_up(waiting)
                raise

    async def grow_async(self, more: int) -> None:
        """As `grow`, without blocking the event loop."""
        import asyncio  # here, so that the process of a device does without

        waiting = self._budget.ask(self, more)
        if waiting is None:
            return
        self._budget.on_shortage()
        try:
            # Shielded: the future is set by the thread that grants the bytes, and must not be
            # cancelled with the wait.
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
        """Hold `nbytes` in all; waits as `grow` does where it holds fewer now."""
        if nbytes > self.nbytes:
            self.grow(nbytes - self.nbytes)
        else:
            self._budget.give_back(self, self.nbytes - nbytes)

    def split(self, purpose: str, nbytes: int) -> Hold:
        """Move `nbytes` of its bytes, at most all, to a new hold for `purpose`, without waiting."""
        return self._budget.split(self, nbytes, purpose)

    def release(self) -> None:
        """Give everything back; a second call does nothing."""
        self._budget.give_back(self, self.nbytes)


def _wake(served: list[_Waiting]) -> None:
    for waiting in served:
        waiting.granted.set_result(None)
