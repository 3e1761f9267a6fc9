"""Slots for requests that wait for the device, so that threads are left for all others."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

import anyio.to_thread
from fastapi import FastAPI

from rhytid.domain.wording import waiting
from rhytid.engine import wanted
from rhytid.errors import BusyError
from rhytid.settings import ServiceSettings

# Threads for requests that need no slot, beside one per slot.
LIGHT_THREADS = 32


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
            raise BusyError(f"{waiting(self._count)} already")
        try:
            with wanted.unless(gone):
                yield
        finally:
            self._free.release()


@asynccontextmanager
async def threads(app: FastAPI) -> AsyncIterator[None]:
    """The lifespan of the app: a thread per slot, and LIGHT_THREADS more."""
    settings: ServiceSettings = app.state.settings
    anyio.to_thread.current_default_thread_limiter().total_tokens = settings.queue + LIGHT_THREADS
    yield
