"""Slots for requests that wait for the device, so that threads are left for all others."""

from __future__ import annotations

import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

import anyio.to_thread
from fastapi import FastAPI

from rhytid.api.live import places
from rhytid.domain.wording import waiting_requests
from rhytid.engine import wanted
from rhytid.errors import BusyError, HostBusyError
from rhytid.support.settings import ServiceSettings

# Threads for requests that need no slot, beside one per slot.
LIGHT_THREADS = 32
# Answers that are made at a time, of those from so many bytes on, and seconds that one waits.
AT_ONCE, HUGE, PATIENCE = 2, 128 << 20, 60.0
_LOOK = 0.1


class DeviceSlots:
    """At most `count` requests wait for the device or encode what it drew."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._free = threading.BoundedSemaphore(count)

    @contextmanager
    def one(self, gone: Callable[[], bool] = lambda: False) -> Iterator[None]:
        """Hold a slot within the block; raises BusyError at once if none is free.

        gone: whether the client is; the engine then stops what it draws in the block and raises
        CancelledError.
        """
        if not self._free.acquire(blocking=False):
            raise BusyError(f"{waiting_requests(self._count)} already")
        try:
            with wanted.unless(gone):
                yield
        finally:
            self._free.release()


class LargeAnswers:
    """At most AT_ONCE answers of HUGE bytes and more are made at a time: the device draws one after
    the other anyway, and what is drawn takes memory until it is encoded."""

    def __init__(self) -> None:
        self._free = threading.BoundedSemaphore(AT_ONCE)

    @contextmanager
    def one(self, nbytes: int) -> Iterator[None]:
        """Make an answer of so many bytes within the block; raises HostBusyError where others take
        too long, CancelledError where nobody waits for it any more."""
        if nbytes < HUGE:
            yield
            return
        until = time.monotonic() + PATIENCE
        while not self._free.acquire(timeout=_LOOK):
            wanted.check()
            if time.monotonic() > until:
                rule = f"{AT_ONCE} at a time where they have {HUGE} bytes or more"
                raise HostBusyError(f"other answers were made for {PATIENCE:g} seconds: {rule}")
        try:
            yield
        finally:
            self._free.release()


@asynccontextmanager
async def threads(app: FastAPI) -> AsyncIterator[None]:
    """The lifespan of the app: a thread per slot, those of live connections too, and LIGHT_THREADS
    more."""
    settings: ServiceSettings = app.state.settings
    slots = settings.queue + places.MOST
    anyio.to_thread.current_default_thread_limiter().total_tokens = slots + LIGHT_THREADS
    yield
