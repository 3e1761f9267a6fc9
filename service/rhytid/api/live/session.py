"""One live connection: reads what comes, draws the newest frame, sends what changed."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import anyio
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect

from rhytid.api.access import RateLimiter
from rhytid.api.live import wire
from rhytid.api.live.drawing import LiveDrawing
from rhytid.api.live.wire import LiveClosed, LiveFrame, Opening, read_frame, read_opening, read_view
from rhytid.api.problems import kind_of
from rhytid.domain.tiles import TileAddress
from rhytid.errors import (
    CancelledError,
    InputError,
    NotFoundError,
    RhytidError,
    public_message,
)

if TYPE_CHECKING:
    from prometheus_client import Counter

T = TypeVar("T")
# Seconds for the header, for anything after it, and for a client to take a message.
HEADER, IDLE, STALLED = 10.0, 300.0, 20.0
logger = logging.getLogger(__name__)


class LiveSession:
    """Answers one accepted connection until it ends.

    begin: makes what draws for a header; blocking.  facts: of the asset, for the answer to the
    header.  rate: messages per second that are read.  dropped: counts frames that
    were replaced by newer ones.
    """

    def __init__(
        self,
        websocket: WebSocket,
        begin: Callable[[Opening], LiveDrawing],
        facts: dict[str, Any],
        vertices: int,
        rate: int,
        dropped: Counter,
    ) -> None:
        self._websocket, self._begin, self._facts = websocket, begin, facts
        self._vertices, self._rate, self._rates = vertices, rate, RateLimiter()
        self._all_dropped = dropped
        self._newest: LiveFrame | None = None
        self._answered: LiveFrame | None = None
        self._last, self._dropped, self._dropped_ever, self._frames = -1, 0, 0, 0
        self._wake = asyncio.Event()
        self._over = False

    @property
    def over(self) -> bool:
        """Whether nobody waits for what is drawn any more."""
        return self._over

    async def run(self) -> None:
        """Until the client is gone, or there is a reason to close; says which to the client."""
        started, code = time.monotonic(), 1000
        try:
            await self._serve()
        except WebSocketDisconnect as gone:
            code = gone.code
        except LiveClosed as closed:
            code = closed.code
            await self._close(closed)
        except Exception:
            code = wire.INTERNAL
            await self._close(LiveClosed(code, "the server's log has the reason"))
            raise
        finally:
            self._over = True
            seconds = time.monotonic() - started
            logger.info(
                "live %s: %d frames, %d dropped, closed with %d after %.1f s",
                self._facts["asset"], self._frames, self._dropped_ever, code, seconds,
            )  # fmt: skip

    async def _serve(self) -> None:
        opening = read_opening(await self._text(HEADER))
        try:
            drawing = await run_in_threadpool(self._begin, opening)
        except NotFoundError as error:
            raise LiveClosed(wire.GONE, public_message(error)) from error
        except InputError as error:
            raise LiveClosed(wire.BAD_MESSAGE, f"header: {error}") from error
        except RhytidError as error:
            later = hasattr(error, "retry_after") or kind_of(error).status == 507
            code = wire.LATER if later else wire.INTERNAL
            raise LiveClosed(code, public_message(error)) from error
        try:
            shapes = drawing.blendshapes
            named = {"shapes": shapes.names, "unknown": shapes.unknown} if shapes else {}
            await self._send_text("ready", **self._facts, **named)
            await self._both(drawing)
        finally:
            drawing.close()

    async def _both(self, drawing: LiveDrawing) -> None:
        """Read and draw side by side; ends when either does, and waits for what is being drawn."""
        reading = asyncio.ensure_future(self._read(drawing))
        answering = asyncio.ensure_future(self._answer_all(drawing))
        try:
            await asyncio.wait({reading, answering}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._over = True
            self._wake.set()
            reading.cancel()
            # A thread draws with the memory that is given back after this.
            await asyncio.wait({reading, answering})
        ends = [task.exception() for task in (answering, reading) if not task.cancelled()]
        for end in ends:
            if end is not None:
                raise end

    async def _read(self, drawing: LiveDrawing) -> None:
        while True:
            message = await self._message(IDLE)
            if message.get("text") is not None:
                drawing.look(read_view(message["text"]))
            else:
                weights = drawing.weights
                frame = read_frame(message["bytes"], self._last, self._vertices, weights)
                self._last = frame.number
                if self._newest is not None:
                    self._dropped += 1
                    self._all_dropped.inc()
                self._newest = frame
            self._wake.set()
            while self._rates.take("messages", self._rate):
                await asyncio.sleep(1.0 / self._rate)

    async def _answer_all(self, drawing: LiveDrawing) -> None:
        while not self._over:
            await self._wake.wait()
            self._wake.clear()
            frame, self._newest = self._newest or self._answered, None
            if frame is not None and not self._over:
                self._answered = frame
                await self._answer(drawing, frame)

    async def _answer(self, drawing: LiveDrawing, frame: LiveFrame) -> None:
        """Draw and send what changed in a frame; an error of the frame is sent in its place."""
        dropped, self._dropped = self._dropped, 0
        self._frames, self._dropped_ever = self._frames + 1, self._dropped_ever + dropped
        started, sent, tiles = time.monotonic(), 0, list[TileAddress]()
        try:
            positions, tiles, found = await run_in_threadpool(drawing.first, frame, dropped)
            for at in tiles:
                if at != tiles[0]:
                    draw = partial(drawing.tile, positions, at, frame.number, dropped)
                    found = await run_in_threadpool(draw)
                if found is not None:
                    await self._send({"type": "websocket.send", "bytes": found})
                    sent += 1
        except CancelledError as error:
            # Also what a frame meets whose asset is deleted while it is drawn.
            if not self._over:
                await self._refuse(error, frame, dropped)
            return
        except NotFoundError as error:
            raise LiveClosed(wire.GONE, public_message(error)) from error
        except RhytidError as error:
            await self._refuse(error, frame, dropped)
            return
        seconds = round(time.monotonic() - started, 6)
        unchanged = len(tiles) - sent
        await self._send_text(
            "frame", frame=frame.number, sent=sent, unchanged=unchanged, dropped=dropped,
            seconds=seconds,
        )  # fmt: skip

    async def _refuse(self, error: RhytidError, frame: LiveFrame, dropped: int) -> None:
        kind = kind_of(error)
        if kind.status == 500:
            logger.error("live %s failed", self._facts["asset"], exc_info=error)
        await self._send_text(
            "problem", frame=frame.number, dropped=dropped, type=kind.type, title=kind.title,
            status=kind.status, detail=public_message(error),
            retry_after=getattr(error, "retry_after", None),
        )  # fmt: skip

    async def _text(self, seconds: float) -> str:
        message = await self._message(seconds)
        if message.get("text") is None:
            raise LiveClosed(wire.BAD_MESSAGE, "the first message must be the header, as text")
        return str(message["text"])

    async def _message(self, seconds: float) -> Any:
        with anyio.move_on_after(seconds):
            message = await self._websocket.receive()
            if message["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(message.get("code", 1005))
            return message
        raise LiveClosed(wire.IDLE, f"nothing came for {seconds:g} seconds")

    async def _send_text(self, what: str, **facts: Any) -> None:
        text = json.dumps({"message": what, **facts})
        await self._send({"type": "websocket.send", "text": text})

    async def _send(self, message: dict[str, Any]) -> None:
        with anyio.move_on_after(STALLED):
            try:
                await self._websocket.send(message)
            except RuntimeError as error:
                # Closed by the protocol itself: a message too large, a pong that did not come.
                raise WebSocketDisconnect(1006, "the connection is closed") from error
            return
        # A code would wait behind what the client does not read.
        raise WebSocketDisconnect(1006, f"the client took nothing for {STALLED:g} seconds")

    async def _close(self, closed: LiveClosed) -> None:
        with anyio.move_on_after(STALLED):
            try:
                await self._websocket.close(closed.code, closed.reason)
            except (WebSocketDisconnect, RuntimeError):
                return
