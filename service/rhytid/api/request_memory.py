"""The memory and the disk that a request holds, from its first byte until its answer is sent."""

from __future__ import annotations

from collections.abc import Awaitable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol, TypeVar

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.api.admission import LargeAnswers
from rhytid.api.spool import Spool
from rhytid.engine.byte_budget import ByteBudget, Hold

_KEY = "rhytid.held"
# In the scope of a request: messages of its answer that the server has taken.
PIECES = "rhytid.pieces"
# Bytes that are passed to the server at a time, and as the last of an answer. So much of it may
# still be in the server's buffers after its memory was given back.
PIECE, LAST = 1 << 20, 1 << 16
# Memory that an upload takes, with all that is decoded of it, over its own bytes.
DECODED = 3
# Small answers and frames have a budget of their own, of so many times less than that of all
# others, so that they do not wait for uploads. One may have an eighth of it, or so many bytes.
SMALL_PART, SMALL, SMALL_SHARE = 4, 16 << 20, 8


def small_budget(host: ByteBudget) -> ByteBudget:
    """Return the budget of small answers and frames, which they have beside `host`."""
    return ByteBudget(host.limit // SMALL_PART, "RHYTID_HOST_MEMORY_MB", host.patience)


class _Closable(Protocol):
    def close(self) -> None: ...


Closed = TypeVar("Closed", bound=_Closable)


class RequestMemory:
    """The parts of the budgets that one request holds; given back when its answer is sent, or it
    fails.

    host: budget of memory.  small: budget of memory for small requests.  spool: budget of disk for
    uploads and large answers, whose files lie in `folder`, or where temporary files are if that
    does not exist.  large: limits how many large answers are made at a time.
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
        """Return the memory of a request that `HoldUntilSent` passed on."""
        state, held = request.app.state, request.scope[_KEY]
        folder = state.settings.store / "partial"
        return cls(held, state.engine.memory, state.small(), state.spool, folder, state.large)

    def hold(self, purpose: str, most: int | None = None) -> Hold:
        """Return a hold of 0 bytes of memory, which may grow.  purpose: `answers` or `uploads`.

        most: bytes that it will have; None = not known, so that they may be many.
        """
        small = most is not None and most <= min(SMALL, self._small.limit // SMALL_SHARE)
        hold = (self._small if small else self._host).hold(purpose)
        self._held.callback(hold.release)
        return hold

    def answer(self, nbytes: int) -> Hold:
        """Hold so many bytes for an answer; waits for them. Raises HostBusyError where others hold
        them too long, HostMemoryError where there are never so many."""
        hold = self.hold("answers", nbytes)
        hold.grow(nbytes)
        return hold

    def at_once(self, nbytes: int) -> bool:
        """Hold so many bytes for an answer that is there already; False, and none are held, where
        they are not free now. Does not block."""
        hold = self._small.taken("answers", nbytes)
        if hold is not None:
            self._held.callback(hold.release)
        return hold is not None

    def aside(self, body: bytes) -> Spool | None:
        """Return a file with an answer, which goes when it is sent; None where the disk has no room
        for it now."""
        if not self._spool.has(len(body)):
            return None
        spool = self.spooled("answers")
        return spool if spool.filled([body], "an answer stays in memory") else None

    def decode(self, nbytes: int) -> Hold:
        """Hold the memory that decoding and using an upload of so many bytes takes, or all of the
        memory where that is less. Waits for it; raises HostBusyError."""
        hold = self.hold("uploads")
        hold.grow(min(DECODED * nbytes, self._host.limit))
        return hold

    def closing(self, thing: Closed) -> Closed:
        """Have the thing closed with the request; returns it."""
        self._held.callback(thing.close)
        return thing

    def spooled(self, purpose: str = "uploads") -> Spool:
        """Return a new file for a body."""
        return self.closing(Spool.at(self._folder, self._spool.hold(purpose)))


class HoldUntilSent:
    """ASGI middleware: sends answers in pieces, and gives back what a request holds when the last
    piece is on its way or the client is gone.

    It is the outermost middleware, so that pieces pass no other. It counts the pieces in the scope,
    where `server.connections` sees whether a client takes its answer.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with an empty stack of held things."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        with ExitStack() as held:
            scope[_KEY] = held
            await self.app(scope, receive, _Pieces(scope, send))


class _Pieces:
    """Sends bodies piece by piece: the server takes the next piece once the client has read most of
    the one before."""

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
    """ASGI middleware for servers that take bytes alone: copies the pieces of `HoldUntilSent`.
    These are views of an answer, which uvicorn sends as they are."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on; send the pieces of its answer as bytes."""

        async def whole(message: Message) -> None:
            body = message.get("body", b"")
            await send(message if isinstance(body, bytes) else {**message, "body": bytes(body)})

        return self.app(scope, receive, whole)
