"""From a receiver of faces to a live connection, and what comes back to a callback."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rhytid_client.errors import LiveClosed, ProblemError, RhytidError
from rhytid_client.live.blocking import Live
from rhytid_client.live.messages import LiveAnswer, LiveTile
from rhytid_client.live_link.receiver import FaceReceiver

# Seconds between two looks whether to stop.
_LOOK = 0.25


class Bridge:
    """Sends the newest face as soon as it comes; tiles go to `on_tile` on the caller's thread.

    live: an open connection whose `shapes` were given as ARKIT.  on_tile: called with each tile.
    on_answer: with the end of each frame, or the problem that it had.
    """

    def __init__(
        self,
        faces: FaceReceiver,
        live: Live,
        on_tile: Callable[[LiveTile], None],
        on_answer: Callable[[LiveAnswer | ProblemError], None] = lambda _: None,
    ) -> None:
        self._faces, self._live = faces, live
        self._on_tile, self._on_answer = on_tile, on_answer
        self._stop = threading.Event()
        self._error: RhytidError | OSError | None = None
        self.sent = 0

    def stop(self) -> None:
        """Let `run` end; from any thread."""
        self._stop.set()

    def run(self) -> None:
        """Until it is stopped or the connection ends; raises what that ended with."""
        sending = threading.Thread(target=self._send, name="rhytid-live-link", daemon=True)
        sending.start()
        try:
            self._receive()
        finally:
            self._stop.set()
            sending.join()
        if self._error is not None:
            raise self._error

    def _receive(self) -> None:
        """Pass on what comes; the sender closes the connection where it is to end."""
        while True:
            try:
                for tile in self._live.receive(None):
                    self._on_tile(tile)
            except ProblemError as problem:
                self._on_answer(problem)
                continue
            except LiveClosed:
                if self._stop.is_set():
                    return
                raise
            assert self._live.answer is not None
            self._on_answer(self._live.answer)

    def _send(self) -> None:
        try:
            while not self._stop.is_set():
                face = self._faces.newest(_LOOK)
                if face is not None:
                    self._live.send(weights=face.weights)
                    self.sent += 1
        except (RhytidError, OSError) as error:
            if not self._stop.is_set():
                self._error = error
        finally:
            self._stop.set()
            self._live.close()
