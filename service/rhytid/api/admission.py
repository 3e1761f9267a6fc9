"""Limits on what is under way at once: requests that wait for the device, large answers, unfinished
jobs of a caller, live connections and listeners."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

import anyio.from_thread
import anyio.to_thread
from fastapi import FastAPI, Request

from rhytid.api.access import Caller
from rhytid.domain.wording import waiting_requests
from rhytid.engine import call_context
from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import BusyError, HostBusyError, NotFoundError, QuotaError
from rhytid.support.settings import ServiceSettings

# Threads for requests that need no slot, beside one per slot.
LIGHT_THREADS = 32
# Answers that are made at a time, of those from so many bytes on, and seconds that one waits.
AT_ONCE, HUGE, PATIENCE = 2, 128 << 20, 60.0
_LOOK = 0.1
# Seconds between two looks at a client: asking the event loop from another thread takes a while.
_EVERY = 0.1
# Places for jobs that are kept before those of ended jobs are looked for.
REMEMBERED = 1000
# Live connections, in all and of one caller.
MOST_LIVE, MOST_LIVE_EACH = 64, 16


@contextmanager
def in_turn(
    free: threading.Lock | threading.Semaphore, blocked: str, rule: str = ""
) -> Iterator[None]:
    """Hold a lock, or a place of a semaphore, within the block. Raises HostBusyError, which says by
    what it was blocked for how long, and CancelledError where the client is gone."""
    until = time.monotonic() + PATIENCE
    while not free.acquire(timeout=_LOOK):
        call_context.check_abandoned()
        if time.monotonic() > until:
            raise HostBusyError(f"{blocked} for {PATIENCE:g} seconds{rule}")
    try:
        yield
    finally:
        free.release()


class DeviceSlots:
    """Lets at most `count` requests wait for the device or encode what it drew."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._free = threading.BoundedSemaphore(count)

    @contextmanager
    def one(self, gone: Callable[[], bool] = lambda: False) -> Iterator[None]:
        """Hold a slot within the block; raises BusyError at once if none is free.

        gone: whether the client has closed its connection. The engine then stops what it draws in
        the block and raises CancelledError.
        """
        if not self._free.acquire(blocking=False):
            raise BusyError(f"{waiting_requests(self._count)} already")
        try:
            with call_context.abandoned_when(gone):
                yield
        finally:
            self._free.release()


class ClientGone:
    """Tells whether the client of a request has closed its connection. For the thread that answers
    a request whose body has been read."""

    def __init__(self, request: Request) -> None:
        self._request = request
        self._gone, self._looked = False, time.monotonic()

    def __call__(self) -> bool:
        """Whether the connection was closed at the last look, which is at most `_EVERY` seconds
        old."""
        now = time.monotonic()
        if not self._gone and now - self._looked >= _EVERY:
            self._looked = now
            self._gone = anyio.from_thread.run(self._request.is_disconnected)
        return self._gone


class LargeAnswers:
    """Lets at most AT_ONCE answers of HUGE bytes and more be made at a time. The device draws one
    after the other anyway, and a map takes memory until it is encoded."""

    def __init__(self) -> None:
        self._free = threading.BoundedSemaphore(AT_ONCE)

    @contextmanager
    def one(self, nbytes: int) -> Iterator[None]:
        """Make an answer of so many bytes within the block. Raises HostBusyError where other
        answers take too long, CancelledError where the client is gone."""
        if nbytes < HUGE:
            yield
            return
        rule = f": {AT_ONCE} at a time where they have {HUGE} bytes or more"
        with in_turn(self._free, "other answers were made", rule):
            yield


class JobShare:
    """A caller's claim to one unfinished job, until that has ended. Several claims to the same job
    count once."""

    def __init__(self, caller: str) -> None:
        self.caller = caller
        self.job: str | None = None

    def take(self, job: str | None) -> None:
        """Name the job that the claim is for; None = no job was needed."""
        self.job = job


class JobShares:
    """Counts the unfinished jobs of each caller. Safe from any thread.

    info: returns the state of a job by its id; raises NotFoundError for a job that is not known any
    more.
    """

    def __init__(self, info: Callable[[str], JobInfo]) -> None:
        self._info = info
        self._lock = threading.Lock()
        self._shares: list[JobShare] = []

    @contextmanager
    def one(self, caller: Caller) -> Iterator[JobShare]:
        """Claim a job within the block; a claim that names no job ends with the block.

        Raises QuotaError where the caller has as many unfinished jobs as it may.
        """
        share = JobShare(caller.name)
        with self._lock:
            full = self._count(caller) >= caller.jobs or len(self._shares) >= REMEMBERED
            kept = self._shares[:] if full else []
        # Not under the lock: the device's process may let it wait.
        ended = {one for one in kept if not self._is_held(one)}
        with self._lock:
            self._shares = [one for one in self._shares if one not in ended]
            if (held := self._count(caller)) >= caller.jobs:
                raise QuotaError(f"{caller.name} has {held} unfinished jobs: at most {caller.jobs}")
            self._shares.append(share)
        try:
            yield share
        finally:
            with self._lock:
                others = [one for one in self._shares if one is not share]
                if share.job is None or any(_same(share, one) for one in others):
                    self._shares = others

    def _count(self, caller: Caller) -> int:
        return sum(share.caller == caller.name for share in self._shares)

    def _is_held(self, share: JobShare) -> bool:
        if share.job is None:  # its request is on its way
            return True
        try:
            return self._info(share.job).state not in ENDED_STATES
        except NotFoundError:
            return False


def _same(one: JobShare, other: JobShare) -> bool:
    return (one.caller, one.job) == (other.caller, other.job)


class CallerPlaces:
    """Counts what callers have open, such as connections. For one thread.

    most, most_each: the limits in all and for one caller.  full, full_each: the messages beyond
    them, with {count}, and {caller} in the second.
    """

    def __init__(self, most: int, most_each: int, full: str, full_each: str) -> None:
        self._most, self._most_each = most, most_each
        self._full, self._full_each = full, full_each
        self._open: Counter[str] = Counter()

    @contextmanager
    def one(self, caller: str) -> Iterator[None]:
        """Count one for the caller within the block. Raises QuotaError beyond `most_each` and
        BusyError beyond `most`, naming the limit."""
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


class LivePlaces(CallerPlaces):
    """Counts live connections."""

    def __init__(self, most: int = MOST_LIVE, most_each: int = MOST_LIVE_EACH) -> None:
        super().__init__(
            most,
            most_each,
            "{count} live connections are open already",
            "{caller} has {count} live connections open already",
        )


@asynccontextmanager
async def threads(app: FastAPI) -> AsyncIterator[None]:
    """The lifespan of the app: it has a thread for each slot of the device, one for each live
    connection, and LIGHT_THREADS more."""
    settings: ServiceSettings = app.state.settings
    slots = settings.queue + MOST_LIVE
    anyio.to_thread.current_default_thread_limiter().total_tokens = slots + LIGHT_THREADS
    yield
    app.state.files.clear()
