"""Shutting down: requests that run may finish, new ones are refused."""

from __future__ import annotations

import asyncio
import logging
import time

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.api.problems import KINDS, problem
from rhytid.errors import DrainingError

_log = logging.getLogger(__name__)
# Paths that are answered to the end: a watcher of the server sees that it runs, and how it ends.
_WATCHING = ("/healthz", "/metrics")
_CLOSING = {"Connection": "close", "Retry-After": str(DrainingError.retry_after)}


class Drain:
    """The state of a server that may be shutting down.

    seconds: the time that requests have to finish.  running: requests that are being answered,
    without those that watch the server.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._by: float | None = None
        self.running = 0

    @property
    def begun(self) -> bool:
        """Whether new requests are refused."""
        return self._by is not None

    @property
    def over(self) -> bool:
        """Whether the server may end: no request runs, or their time is over."""
        by = self._by
        return by is not None and (self.running == 0 or time.monotonic() >= by)

    def begin(self) -> None:
        """Refuse new requests from now on."""
        if self._by is None:
            self._by = time.monotonic() + self._seconds


class _Closing:
    """Sends an answer; an answer that begins after the drain has begun closes its connection."""

    def __init__(self, send: Send, drain: Drain) -> None:
        self._send, self._drain = send, drain
        self.answered = False

    async def __call__(self, message: Message) -> None:
        """Send a message."""
        if message["type"] == "http.response.start":
            self.answered = True
            if self._drain.begun:
                MutableHeaders(scope=message)["Connection"] = "close"
        await self._send(message)


class Draining:
    """ASGI middleware: counts the requests that run. Once the drain has begun it refuses new
    requests and closes connections. A request that the server cancels at the end of the drain is
    refused in the same way; an answer that is half sent then is broken off, and the log says so."""

    def __init__(self, app: ASGIApp, drain: Drain) -> None:
        self.app = app
        self._drain = drain

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer 503."""
        watching = scope.get("path") in _WATCHING
        if self._drain.begun and not watching and scope["type"] in ("http", "websocket"):
            await self._refused(scope, receive, send)
            return
        # A WebSocket has no end of its own: the server closes it.
        counts = scope["type"] == "http" and not watching
        self._drain.running += counts
        closing = _Closing(send, self._drain)
        try:
            await self.app(scope, receive, closing)
        except asyncio.CancelledError:
            if not (counts and self._drain.begun):
                raise
            if closing.answered:
                _log.warning("%s %s: broken off, the server ends", scope["method"], scope["path"])
            else:
                await self._refused(scope, receive, send)
        finally:
            self._drain.running -= counts

    async def _refused(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" and "websocket.http.response" not in scope["extensions"]:
            await send({"type": "websocket.close", "code": 1001, "reason": "shutting down"})
            return
        kind = KINDS[DrainingError]
        detail = "the server is shutting down: ask again, on a new connection"
        refusal = problem(kind.status, detail, kind.title, kind.type, _CLOSING)
        await refusal(scope, receive, send)
