"""What a request holds of memory and disk, from its first byte until its answer is sent."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol, TypeVar

import anyio
from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.api.device_slots import LargeAnswers
from rhytid.api.spool import Spool
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.errors import HostBusyError, StorageError

logger = logging.getLogger(__name__)
_KEY = "rhytid.held"
# Bytes that are passed to the server at a time. So much of an answer may still be in its buffers
# after its memory was given back.
PIECE = 1 << 18
# What is decoded of an upload, and the bytes that it is decoded from, over these bytes.
DECODED = 3


class _Closable(Protocol):
    def close(self) -> None: ...


Closed = TypeVar("Closed", bound=_Closable)


class RequestMemory:
    """What one request holds of the budgets; given back when its answer is sent, or it fails.

    host: bytes of memory.  spool: bytes of uploads and large answers on disk, in `folder` (None =
    that of temporary files).
    """

    def __init__(
        self,
        held: ExitStack,
        host: ByteBudget,
        spool: ByteBudget,
        folder: Path | None,
        large: LargeAnswers,
    ) -> None:
        self._held, self._host, self._spool, self._folder = held, host, spool, folder
        # Held while an answer is made: see `LargeAnswers.one`.
        self.making = large.one

    @classmethod
    def of(cls, request: Request) -> RequestMemory:
        """Of a request that `HoldUntilSent` passed on."""
        state = request.app.state
        partial = state.settings.store / "partial"
        folder = partial if partial.is_dir() else None
        held = request.scope[_KEY]
        return cls(held, state.engine.memory, state.spool, folder, state.large)

    def hold(self, purpose: str) -> Hold:
        """A hold of 0 bytes of memory, for `answers` or `uploads`."""
        hold = self._host.hold(purpose)
        self._held.callback(hold.release)
        return hold

    def answer(self, nbytes: int) -> Hold:
        """So many bytes for an answer; waits for them. Raises HostBusyError and HostMemoryError."""
        hold = self.hold("answers")
        hold.grow(nbytes)
        return hold

    def aside(self, body: bytes) -> Spool | None:
        """A file with an answer, until it is sent; None where the disk has no room for it now."""
        if not self._spool.has(len(body)):
            return None
        spool = self.spooled("answers")
        try:
            spool.fill(body)
        except (HostBusyError, StorageError) as error:
            logger.warning("an answer stays in memory: %s", error)
            spool.close()
            return None
        return spool

    def decode(self, nbytes: int) -> Hold:
        """What an upload of so many bytes takes while it is decoded and used; all of the memory,
        where it takes more. Waits for it; raises HostBusyError."""
        hold = self.hold("uploads")
        hold.grow(min(DECODED * nbytes, self._host.limit))
        return hold

    def closing(self, thing: Closed) -> Closed:
        """The thing itself, which is closed with the request."""
        self._held.callback(thing.close)
        return thing

    def spooled(self, purpose: str = "uploads") -> Spool:
        """A file for the body."""
        spool = Spool(self._spool.hold(purpose), self._folder)
        self._held.callback(spool.close)
        return spool


class HoldUntilSent:
    """ASGI middleware: hands answers out in pieces, and gives back what a request holds when the
    last is on its way or the client is gone.

    stalled: seconds in which a client must take a piece; it is disconnected where it does not.
    """

    def __init__(self, app: ASGIApp, stalled: float) -> None:
        self.app, self._stalled = app, stalled

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with an empty stack of what it holds."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        with ExitStack() as held:
            scope[_KEY] = held
            await self.app(scope, receive, _Pieces(scope, send, self._stalled))


class _Pieces:
    """Sends bodies piece by piece: the server takes the next once the client has read most of the
    one before."""

    def __init__(self, scope: Scope, send: Send, stalled: float) -> None:
        self._path, self._send, self._stalled = scope["path"], send, stalled
        self._dropped = False

    async def __call__(self, message: Message) -> None:
        body = message.get("body", b"")
        if len(body) <= PIECE:
            await self._one(message)
            return
        view = memoryview(body)
        for start in range(0, len(body), PIECE):
            more = start + PIECE < len(body) or message.get("more_body", False)
            piece = bytes(view[start : start + PIECE])
            await self._one({**message, "body": piece, "more_body": more})

    async def _one(self, message: Message) -> None:
        if self._dropped:
            return
        with anyio.move_on_after(self._stalled) as waiting:
            await self._send(message)
        if waiting.cancelled_caught:
            # The server sees an answer without an end, and closes the connection.
            self._dropped = True
            path = self._path.encode("unicode_escape").decode("ascii")
            logger.warning("%s: the client took nothing for %g seconds", path, self._stalled)
