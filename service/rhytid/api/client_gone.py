"""Whether the client of a request has closed its connection."""

from __future__ import annotations

import time

import anyio.from_thread
from fastapi import Request

# Seconds between two looks: asking the event loop from another thread takes a while.
_EVERY = 0.1


class ClientGone:
    """Asks for one request, whose body has been read, from the thread that answers it."""

    def __init__(self, request: Request) -> None:
        self._request = request
        self._gone, self._looked = False, time.monotonic()

    def __call__(self) -> bool:
        """Whether the client was gone when it was last looked after."""
        now = time.monotonic()
        if not self._gone and now - self._looked >= _EVERY:
            self._looked = now
            self._gone = anyio.from_thread.run(self._request.is_disconnected)
        return self._gone
