"""The frames that were sent, kept by the server: a process that is started anew gets them again."""

from __future__ import annotations

import itertools
import logging
import threading
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.keyed_locks import KeyedLocks

Positions = NDArray[np.float32]
# Sends positions of a frame of an asset to a process.
Put = Callable[[DeviceProcess, str, str, Positions], None]
_versions = itertools.count(1)
_log = logging.getLogger(__name__)


@dataclass
class _Kept:
    positions: Positions
    # The process that has the frame.
    process: DeviceProcess
    version: int


class FrameLedger:
    """Positions by asset and name, and which process has them.

    limit: bytes that are kept; frames beyond it are lost with the process.  put: sends a frame.
    """

    def __init__(self, limit: int, put: Put) -> None:
        self._limit, self._put = limit, put
        self._used = 0
        self._lock = threading.Lock()
        self._kept: dict[str, dict[str, _Kept]] = {}
        # A frame is sent, or sent again, by one thread at a time.
        self._sending = KeyedLocks()

    def sending(self, asset: str, name: str) -> AbstractContextManager[None]:
        """Held while a frame is sent: the process and the ledger then have the same."""
        return self._sending.holding((asset, name))

    def keep(self, asset: str, name: str, positions: Positions, process: DeviceProcess) -> None:
        """Keep what a process has as a frame."""
        with self._lock:
            self._drop(asset, name)
            if self._used + positions.nbytes > self._limit:
                _log.warning("frame %s is not kept: it is lost with the device's process", name)
                return
            self._used += positions.nbytes
            self._kept.setdefault(asset, {})[name] = _Kept(positions, process, next(_versions))

    def forget(self, asset: str, name: str | None = None) -> None:
        """Forget a frame, or all of an asset."""
        with self._lock:
            names = list(self._kept.get(asset, {})) if name is None else [name]
            for one in names:
                self._drop(asset, one)

    def names(self, asset: str) -> list[str]:
        """Of the frames of an asset."""
        with self._lock:
            return list(self._kept.get(asset, {}))

    def version(self, asset: str, name: str) -> int:
        """Another number for other positions; 0 of a frame that is not kept."""
        kept = self._kept.get(asset, {}).get(name)
        return 0 if kept is None else kept.version

    def bring(self, process: DeviceProcess, asset: str, names: Iterable[str]) -> None:
        """Send frames to a process that does not have them; raises what sending does."""
        for name in names:
            kept = self._kept.get(asset, {}).get(name)
            if kept is None or kept.process is process:
                continue
            with self.sending(asset, name):
                if kept.process is not process:
                    self._put(process, asset, name, kept.positions)
                    kept.process = process

    def _drop(self, asset: str, name: str) -> None:
        kept = self._kept.get(asset, {}).pop(name, None)
        if kept is not None:
            self._used -= kept.positions.nbytes
            if not self._kept[asset]:
                del self._kept[asset]
