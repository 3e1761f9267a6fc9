"""Frames of the board that a replica lacks."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import Any, TypeVar

from rhytid.domain.frame import NEUTRAL
from rhytid.engine_process.keyed_locks import KeyedLocks
from rhytid.engine_process.remote_frames import RemoteFrames
from rhytid.errors import DeviceLostError, FrameMemoryError, NotFoundError
from rhytid.fleet.board import Positions
from rhytid.fleet.remote_board import RemoteBoard

# Seconds for which what the board has said of an asset is taken as it was.
FRESH = 1.0
# Seconds for which a board that did not answer is asked nothing: each call would wait for it.
AWAY = 3.0
# Seconds after which a frame that nobody used may go where there is no room.
IDLE = 60.0
T = TypeVar("T")
_log = logging.getLogger(__name__)


class BoardFullError(FrameMemoryError):
    """The board has no room for a frame; what a replica drops makes none."""

    def __init__(self, asset: str, name: str) -> None:
        super().__init__(
            f"frame {name} of {asset} does not fit into the memory for frames of all replicas "
            "(RHYTID_FRAME_MEMORY_MB for each): delete some"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return FrameMemoryError, self.args


class FrameSync:
    """Which version of each frame the engine of this replica has.

    A frame is fetched where the ingress knows of a newer one, or where the board does: it is asked
    once a second for each asset that is in use. Where the engine has no room, frames of assets go
    that were not used of late: the board has them.
    """

    def __init__(self, frames: RemoteFrames, board: RemoteBoard) -> None:
        self._frames, self._board = frames, board
        self._versions: dict[str, dict[str, int]] = {}
        # When the engine had a frame as the board had it.
        self._looked: dict[str, dict[str, float]] = {}
        self._away = -AWAY
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
        if name == NEUTRAL or self._good(asset, name, wanted):
            return

        def bring() -> None:
            with self.changing(asset):
                if not self._good(asset, name, wanted):  # it may have come while this one waited
                    self._fetch(asset, [name], wanted)

        self.with_room(asset, bring)

    def keep(self, asset: str, name: str, positions: Positions) -> int:
        """Give the board a frame that the engine has taken; its version. Raises BoardFullError
        where there is no room: the engine then fetches the frame that was there before."""
        version = self._board.keep(asset, name, positions)
        if not version:
            self.note(asset, name, 0)
            with suppress(NotFoundError):
                self._frames.delete(asset, name)
            raise BoardFullError(asset, name)
        self.note(asset, name, version)
        self._looked.setdefault(asset, {})[name] = time.monotonic()
        return version

    def bring_all(self, asset: str) -> None:
        """See that the engine has every frame of an asset."""

        def bring() -> None:
            with self.changing(asset):
                self._fetch(asset, None, 0)

        self.with_room(asset, bring)

    def with_room(self, asset: str, work: Callable[[], T]) -> T:
        """What the work returns that puts frames of an asset into the engine; frames of others go
        where there is no room. Not to be called while `changing` is held."""
        while True:
            try:
                return work()
            except FrameMemoryError as error:  # noqa: PERF203
                others = () if isinstance(error, BoardFullError) else self._idle(asset)
                if not any(map(self._drop_unused, others)):
                    raise

    def _idle(self, asset: str) -> list[str]:
        """Other assets, none of whose frames was used of late; the least recently used first."""
        with self._lock:
            used = {
                name: max(self._looked.get(name, {}).values(), default=0.0)
                for name in self._versions
                if name != asset
            }
        before = time.monotonic() - IDLE
        return sorted((name for name in used if used[name] < before), key=used.__getitem__)

    def _drop_unused(self, asset: str) -> bool:
        """Drop frames of an asset that the board has; whether there were any."""
        with self.changing(asset):
            there = self._versions_there(asset)
            here = dict(self._versions.get(asset, {}))
            known = [
                name for name, version in here.items() if version and there.get(name) == version
            ]
            for name in known:
                self.note(asset, name, 0)
                with suppress(NotFoundError):
                    self._frames.delete(asset, name)
        return bool(known)

    def _fetch(self, asset: str, names: list[str] | None, wanted: int) -> None:
        try:
            there = self._versions_there(asset)
            for name in there if names is None else names:
                if there.get(name, 0) > self._version(asset, name):
                    self._take(asset, name)
                if self._version(asset, name):  # not names of frames that there never were
                    self._looked.setdefault(asset, {})[name] = time.monotonic()
        except DeviceLostError:
            if names is None or any(self._version(asset, name) < wanted for name in names):
                raise

    def _versions_there(self, asset: str) -> dict[str, int]:
        if time.monotonic() - self._away < AWAY:
            raise DeviceLostError("the board of the fleet did not answer; try later")
        try:
            return self._board.versions(asset)
        except DeviceLostError:
            self._away = time.monotonic()
            _log.warning("frames of %s are taken as they are here: no board answers", asset)
            raise

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

    def _good(self, asset: str, name: str, wanted: int) -> bool:
        looked = self._looked.get(asset, {}).get(name)
        fresh = looked is not None and time.monotonic() - looked < FRESH
        return fresh and self._version(asset, name) >= max(wanted, 1)
