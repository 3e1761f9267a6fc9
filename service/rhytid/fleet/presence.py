"""Which replicas there are, as an ingress heard last."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

from rhytid.errors import DeviceLostError
from rhytid.fleet.board import PRESENT, Report
from rhytid.fleet.remote_board import RemoteBoard

# Seconds between two times that the board is asked.
LOOK = 1.0


class Presence:
    """Asks the board again and again, so that nobody has to wait for it: figures are read where
    nothing may block."""

    def __init__(self, board: RemoteBoard) -> None:
        self._board = board
        self._closing = threading.Event()
        self._heard: tuple[float, list[Report]] = (0.0, [])
        self._thread = threading.Thread(target=self._run, name="rhytid-presence", daemon=True)
        self._thread.start()

    @property
    def reports(self) -> list[Report]:
        """Of the replicas that are there; none where the board has not answered for long."""
        at, reports = self._heard
        return reports if time.monotonic() - at < PRESENT else []

    def look(self) -> list[Report]:
        """As `reports`, asked for now; what was heard before where the board does not answer."""
        with suppress(DeviceLostError):
            self._heard = (time.monotonic(), self._board.reports())
        return self.reports

    def close(self) -> None:
        """Ask no more."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            self.look()
            self._closing.wait(LOOK)
