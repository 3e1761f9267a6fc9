"""A live connection for asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import AsyncExitStack
from typing import Any

from numpy.typing import ArrayLike

from rhytid_client.live.messages import (
    Address,
    LiveAnswer,
    LiveAsset,
    LiveTile,
    read_answer,
    read_ready,
    view_message,
)
from rhytid_client.live.opening import FrameCounter, LiveOpening, library, translated
from rhytid_client.methods import ANSWER_SECONDS


class AsyncLive:
    """Frames out, tiles in: the methods of `Live`, to be awaited; use it in `async with`.

    asset: what the server said of the asset.  answer: what became of the frame that `receive`
    ended with last.
    """

    asset: LiveAsset
    _socket: Any

    def __init__(self, opening: LiveOpening) -> None:
        self._opening, self._frames = opening, FrameCounter()
        self._open, self._socket = AsyncExitStack(), None
        self.answer: LiveAnswer | None = None

    async def __aenter__(self) -> AsyncLive:
        connect, call = library("asyncio.client").connect, self._opening.call
        with translated(call):
            made = connect(self._opening.url, **self._opening.options)
            self._socket = await self._open.enter_async_context(made)
        try:
            with translated(call):
                await self._socket.send(self._opening.header)
                self.asset = read_ready(await self._came(ANSWER_SECONDS), call)
        except BaseException:
            await self._open.aclose()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._open.aclose()

    async def close(self) -> None:
        """End the connection; `receive` then raises LiveClosed."""
        if self._socket is not None:
            await self._socket.close()

    async def send(
        self,
        *,
        positions: ArrayLike | None = None,
        weights: ArrayLike | Mapping[str, float] | None = None,
        frame: int | None = None,
    ) -> int:
        """As `Live.send`."""
        number, message = self._frames.message(self.asset.shapes, positions, weights, frame)
        with translated(self._opening.call):
            await self._socket.send(message)
        return number

    async def look(
        self,
        tiles: Iterable[Address] | None = None,
        *,
        camera: ArrayLike | None = None,
        level: int = 0,
        two_sided: bool = False,
    ) -> None:
        """As `Live.look`."""
        message = view_message(tiles, camera, level, two_sided)
        with translated(self._opening.call):
            await self._socket.send(message)

    async def receive(self, timeout: float | None = ANSWER_SECONDS) -> AsyncIterator[LiveTile]:
        """As `Live.receive`."""
        while True:
            with translated(self._opening.call):
                message = await self._came(timeout)
            found = read_answer(message, self._opening.call)
            if isinstance(found, LiveAnswer):
                self.answer = found
                return
            yield found

    async def _came(self, timeout: float | None) -> Any:
        try:
            return await asyncio.wait_for(self._socket.recv(), timeout)
        except asyncio.TimeoutError as exc:  # another class than TimeoutError in Python 3.10
            raise TimeoutError(f"nothing came for {timeout} seconds") from exc
