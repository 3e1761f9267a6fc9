"""Frames of the board that a replica lacks."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import AbstractContextManager, suppress
from typing import Protocol

from rhytid.domain.frame import NEUTRAL
from rhytid.engine_process.keyed_locks import KeyedLocks
from rhytid.engine_process.remote_frames import RemoteFrames
from rhytid.errors import DeviceLostError, NotFoundError
from rhytid.fleet.board import Positions

# Seconds for which what the board has said of an asset is taken as it was.
FRESH = 1.0
_log = logging.getLogger(__name__)


class BoardCalls(Protocol):
    """The calls of `Board`, wherever it is; they raise DeviceLostError where it does not answer."""

    def keep(self, asset: str, name: str, positions: Positions) -> int:
        """As of `Board`."""

    def remove(self, asset: str, name: str) -> int:
        """As of `Board`."""

    def forget(self, asset: str) -> None:
        """As of `Board`."""

    def versions(self, asset: str) -> dict[str, int]:
        """As of `Board`."""

    def frame(self, asset: str, name: str) -> tuple[int, Positions | None]:
        """As of `Board`."""


class FrameSync:
    """Which version of each frame the engine of this replica has.

    A frame is fetched where the ingress knows of a newer one, or where the board does: it is asked
    once a second for each asset that is in use.
    """

    def __init__(self, frames: RemoteFrames, board: BoardCalls) -> None:
        self._frames, self._board = frames, board
        self._versions: dict[str, dict[str, int]] = {}
        # When the board was asked for a frame that there is.
        self._looked: dict[str, dict[str, float]] = {}
        self._locks = KeyedLocks()
        self._lock = threading.Lock()

    def changing(self, asset: str) -> AbstractContextManager[None]:
        """Held while a frame of an asset is stored: the engine and the board get them in one
        order."""
        return self._locks.holding(asset)

    def note(self, asset: str, name: str, version: int) -> None:
        """The engine has this version of a frame."""
        with self._lock:
            self._versions.setdefault(asset, {})[name] = version

    def forget(self, asset: str) -> None:
        """The engine does not have the asset any more."""
        with self._lock:
            self._versions.pop(asset, None)
            self._looked.pop(asset, None)

    def bring(self, asset: str, name: str, wanted: int) -> None:
        """See that the engine has a frame as it is now.  wanted: the version that there is at
        least, as far as the caller knows."""
        if name == NEUTRAL or (self._fresh(asset, name) and self._version(asset, name) >= wanted):
            return
        with self.changing(asset):
            self._fetch(asset, [name], wanted)

    def bring_all(self, asset: str) -> None:
        """See that the engine has every frame of an asset."""
        with self.changing(asset):
            self._fetch(asset, None, 0)

    def _fetch(self, asset: str, names: list[str] | None, wanted: int) -> None:
        try:
            there = self._board.versions(asset)
            for name in there if names is None else names:
                if there.get(name, 0) > self._version(asset, name):
                    self._take(asset, name)
                if name in there:
                    self._looked.setdefault(asset, {})[name] = time.monotonic()
        except DeviceLostError:
            if names is None or any(self._version(asset, name) < wanted for name in names):
                raise
            _log.warning("frames of %s are taken as they are here: no board answers", asset)

    def _take(self, asset: str, name: str) -> None:
        version, positions = self._board.frame(asset, name)
        if positions is not None:
            self._frames.put(asset, name, positions)
        elif version:
            with suppress(NotFoundError):
                self._frames.delete(asset, name)
        self.note(asset, name, version)

    def _version(self, asset: str, name: str) -> int:
        return self._versions.get(asset, {}).get(name, 0)

    def _fresh(self, asset: str, name: str) -> bool:
        looked = self._looked.get(asset, {}).get(name)
        return looked is not None and time.monotonic() - looked < FRESH
