"""What a request holds of memory and disk, from its first byte until its answer is sent."""

from __future__ import annotations

import logging
from collections.abc import Awaitable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol, TypeVar

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.api.admission import LargeAnswers
from rhytid.api.spool import Spool
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.errors import HostBusyError, StorageError

logger = logging.getLogger(__name__)
_KEY = "rhytid.held"
# In the scope of a request: messages of its answer that the server has taken.
PIECES = "rhytid.pieces"
# Bytes that are passed to the server at a time, and as the last of an answer. So much of it may
# still be in the server's buffers after its memory was given back.
PIECE, LAST = 1 << 20, 1 << 16
# What is decoded of an upload, and the bytes that it is decoded from, over these bytes.
DECODED = 3
# Small answers and frames have a budget of their own, of so many times less than that of all
# others, so that they do not wait for uploads. One may have an eighth of it, or so many bytes.
SMALL_PART, SMALL, SMALL_SHARE = 4, 16 << 20, 8


def small_budget(host: ByteBudget) -> ByteBudget:
    """What small answers and frames may hold beside that budget."""
    return ByteBudget(host.limit // SMALL_PART, "RHYTID_HOST_MEMORY_MB", host.patience)


class _Closable(Protocol):
    def close(self) -> None: ...


Closed = TypeVar("Closed", bound=_Closable)


class RequestMemory:
    """What one request holds of the budgets; given back when its answer is sent, or it fails.

    host: bytes of memory.  small: those of small requests.  spool: bytes of uploads and large
    answers on disk, in `folder`, where it is there, else where temporary files are.
    """

    def __init__(
        self,
        held: ExitStack,
        host: ByteBudget,
        small: ByteBudget,
        spool: ByteBudget,
        folder: Path,
        large: LargeAnswers,
    ) -> None:
        self._held, self._host, self._small = held, host, small
        self._spool, self._folder = spool, folder
        # Held while an answer is made: see `LargeAnswers.one`.
        self.making = large.one

    @classmethod
    def of(cls, request: Request) -> RequestMemory:
        """Of a request that `HoldUntilSent` passed on."""
        state, held = request.app.state, request.scope[_KEY]
        folder = state.settings.store / "partial"
        return cls(held, state.engine.memory, state.small(), state.spool, folder, state.large)

    def hold(self, purpose: str, most: int | None = None) -> Hold:
        """A hold of 0 bytes of memory, for `answers` or `uploads`.

        most: bytes that it will have; None = not known, so that they may be many.
        """
        small = most is not None and most <= min(SMALL, self._small.limit // SMALL_SHARE)
        hold = (self._small if small else self._host).hold(purpose)
        self._held.callback(hold.release)
        return hold

    def answer(self, nbytes: int) -> Hold:
        """So many bytes for an answer; waits for them. Raises HostBusyError and HostMemoryError."""
        hold = self.hold("answers", nbytes)
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
        folder = self._folder if self._folder.is_dir() else None
        spool = Spool(self._spool.hold(purpose), folder)
        self._held.callback(spool.close)
        return spool


class HoldUntilSent:
    """ASGI middleware: hands answers out in pieces, and gives back what a request holds when the
    last is on its way or the client is gone.

    It is the outermost, so that pieces pass no other. It counts them in the scope, by which
    `cli.connections` sees whether a client takes its answer.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with an empty stack of what it holds."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        with ExitStack() as held:
            scope[_KEY] = held
            await self.app(scope, receive, _Pieces(scope, send))


class _Pieces:
    """Sends bodies piece by piece: the server takes the next once the client has read most of the
    one before."""

    def __init__(self, scope: Scope, send: Send) -> None:
        self._scope, self._send = scope, send
        scope[PIECES] = 0

    async def __call__(self, message: Message) -> None:
        body = message.get("body", b"")
        if len(body) <= LAST:
            await self._one(message)
            return
        rest = memoryview(body)
        while len(rest) > LAST:
            size = min(PIECE, len(rest) - LAST)
            await self._one({**message, "body": rest[:size], "more_body": True})
            rest = rest[size:]
        await self._one({**message, "body": rest})

    async def _one(self, message: Message) -> None:
        await self._send(message)
        self._scope[PIECES] += 1


class WholeBytes:
    """ASGI middleware for servers that take bytes alone: copies the pieces of `HoldUntilSent`. They
    are views of an answer, which uvicorn sends as they are."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on."""

        async def whole(message: Message) -> None:
            body = message.get("body", b"")
            await send(message if isinstance(body, bytes) else {**message, "body": bytes(body)})

        return self.app(scope, receive, whole)
