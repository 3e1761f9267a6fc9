"""Places for the requests that wait for the device, so that all others still find a thread."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

import anyio.to_thread
from fastapi import FastAPI

from rhytid.domain.wording import waiting
from rhytid.errors import BusyError
from rhytid.settings import ServiceSettings

# Threads for what does not wait for the device: as many more as there are places.
LIGHT_THREADS = 32


class DeviceSlots:
    """At most `count` requests wait for the device or encode what it drew."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._free = threading.BoundedSemaphore(count)

    @contextmanager
    def one(self) -> Iterator[None]:
        """Hold a place inside the block; raises BusyError at once where none is free."""
        if not self._free.acquire(blocking=False):
            raise BusyError(f"{waiting(self._count)} already")
        try:
            yield
        finally:
            self._free.release()


@asynccontextmanager
async def threads(app: FastAPI) -> AsyncIterator[None]:
    """The lifespan of the app: a thread for every place, and some for the light requests."""
    settings: ServiceSettings = app.state.settings
    anyio.to_thread.current_default_thread_limiter().total_tokens = settings.queue + LIGHT_THREADS
    yield
