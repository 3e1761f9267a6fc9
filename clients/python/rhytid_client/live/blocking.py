"""A live connection for programs that wait."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
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


class Live:
    """Frames out, tiles in; one thread may send while another receives.

    Use it in `with`. Calls raise what the server says as the client's other calls do, LiveClosed
    where the connection ended, ConnectionFailed where there is none.

    asset: what the server said of the asset.  answer: what became of the frame that `receive`
    ended with last.
    """

    asset: LiveAsset
    _socket: Any

    def __init__(self, opening: LiveOpening) -> None:
        self._opening, self._frames = opening, FrameCounter()
        self._open, self._socket = ExitStack(), None
        self.answer: LiveAnswer | None = None

    def __enter__(self) -> Live:
        connect, call = library("sync.client").connect, self._opening.call
        with translated(call):
            made = connect(self._opening.url, **self._opening.options)
            self._socket = self._open.enter_context(made)
        try:
            with translated(call):
                self._socket.send(self._opening.header)
                self.asset = read_ready(self._socket.recv(ANSWER_SECONDS), call)
        except BaseException:
            self._open.close()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        self._open.close()

    def close(self) -> None:
        """End the connection, from any thread; `receive` then raises LiveClosed."""
        if self._socket is not None:
            self._socket.close()

    def send(
        self,
        *,
        positions: ArrayLike | None = None,
        weights: ArrayLike | Mapping[str, float] | None = None,
        frame: int | None = None,
    ) -> int:
        """Send a frame, without waiting for what comes of it; returns its number.

        positions: (V, 3).  weights: in the order of `asset.shapes`, or by name, others being 0.
        frame: a number that is larger than the one before; the next where none is given.
        """
        number, message = self._frames.message(self.asset.shapes, positions, weights, frame)
        with translated(self._opening.call):
            self._socket.send(message)
        return number

    def look(
        self,
        tiles: Iterable[Address] | None = None,
        *,
        camera: ArrayLike | None = None,
        level: int = 0,
        two_sided: bool = False,
    ) -> None:
        """Want other tiles from now on: those of the last frame come at once, as an answer."""
        message = view_message(tiles, camera, level, two_sided)
        with translated(self._opening.call):
            self._socket.send(message)

    def receive(self, timeout: float | None = ANSWER_SECONDS) -> Iterator[LiveTile]:
        """The tiles of the next frame that was drawn, as they come; then `answer` is about it.

        timeout: seconds to wait for each; None = for ever. Raises ConnectionFailed after it.
        """
        while True:
            with translated(self._opening.call):
                message = self._socket.recv(timeout)
            found = read_answer(message, self._opening.call)
            if isinstance(found, LiveAnswer):
                self.answer = found
                return
            yield found
