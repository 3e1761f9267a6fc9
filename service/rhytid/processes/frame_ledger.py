"""The frames that were sent, kept by the server: a process that is started anew gets them again."""

from __future__ import annotations

import itertools
import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.processes.device_process import DeviceProcess
from rhytid.processes.keyed_locks import KeyedLocks

Positions = NDArray[np.float32]
# Sends positions of a frame of an asset to a process.
Put = Callable[[DeviceProcess, str, str, Positions], None]
# Removed assets that are remembered, for frames that are being sent to them.
_REMOVED = 1000
_versions = itertools.count(1)
_log = logging.getLogger(__name__)


@dataclass
class _Kept:
    positions: Positions
    # The process that has the frame; None where it is not known which has it.
    process: DeviceProcess | None
    version: int


class FrameLedger:
    """Positions by asset and name, and which process has them.

    Whoever sends or deletes a frame holds `sending` until the ledger says the same as the process.
    So a process that is started anew gets what was stored last, and nothing that was deleted.

    limit: bytes that are kept; frames beyond it are lost with the process.  put: sends a frame.
    """

    def __init__(self, limit: int, put: Put) -> None:
        self._limit, self._put = limit, put
        self._used = 0
        self._lock = threading.Lock()
        self._kept: dict[str, dict[str, _Kept]] = {}
        self._removed: OrderedDict[str, int] = OrderedDict()
        # A frame is sent, sent again or deleted by one thread at a time.
        self._sending = KeyedLocks()

    def sending(self, asset: str, name: str) -> AbstractContextManager[None]:
        """Held while a frame is sent or deleted: the process and the ledger then have the same."""
        return self._sending.holding((asset, name))

    def mark(self) -> int:
        """Names this moment, for `keep`."""
        return next(_versions)

    def keep(
        self, asset: str, name: str, positions: Positions, process: DeviceProcess, since: int
    ) -> None:
        """Keep what a process has as a frame, while `sending` is held.

        since: `mark` before it was sent. Nothing is kept where the asset was removed after it. A
        frame that was stored after it stays, and is sent again: it is not known which of the two
        the process took last.
        """
        with self._lock:
            if self._removed.get(asset, 0) > since:
                return
            old = self._kept.get(asset, {}).get(name)
            if old is not None and old.version > since:
                old.process = None
                return
            self._drop(asset, name)
            if self._used + positions.nbytes > self._limit:
                _log.warning("frame %s is not kept: it is lost with the device's process", name)
                return
            self._used += positions.nbytes
            self._kept.setdefault(asset, {})[name] = _Kept(positions, process, next(_versions))

    def doubt(self, asset: str, name: str) -> None:
        """A process may have stored or deleted a frame, without an answer: the frame that is kept
        is sent again before it is used."""
        with self._lock:
            kept = self._kept.get(asset, {}).get(name)
            if kept is not None:
                kept.process = None

    def forget(self, asset: str, name: str | None = None) -> None:
        """Forget a frame that was deleted, or all of an asset that was removed."""
        if name is not None:
            with self.sending(asset, name), self._lock:
                self._drop(asset, name)
            return
        with self._lock:
            self._removed[asset] = next(_versions)
            self._removed.move_to_end(asset)
            while len(self._removed) > _REMOVED:
                self._removed.popitem(last=False)
        for one in self.names(asset):  # each once nobody sends it
            self.forget(asset, one)

    def names(self, asset: str) -> list[str]:
        """Of the frames of an asset."""
        with self._lock:
            return list(self._kept.get(asset, {}))

    def version(self, asset: str, name: str) -> int:
        """Another number for other positions; 0 of a frame that is not kept."""
        with self._lock:
            kept = self._kept.get(asset, {}).get(name)
            return 0 if kept is None else kept.version

    def bring(self, process: DeviceProcess, asset: str, names: Iterable[str] | None = None) -> None:
        """Send frames of an asset to a process that does not have them; raises what sending does.

        names: None = all that there are.
        """
        for name in self.names(asset) if names is None else names:
            if self._lacked(process, asset, name) is None:
                continue
            with self.sending(asset, name):
                # Looked up again: another was stored, or it was deleted, while this thread waited.
                kept = self._lacked(process, asset, name)
                if kept is not None:
                    self._put(process, asset, name, kept.positions)
                    kept.process = process

    def _lacked(self, process: DeviceProcess, asset: str, name: str) -> _Kept | None:
        """A frame that a process does not have."""
        with self._lock:
            kept = self._kept.get(asset, {}).get(name)
            return None if kept is None or kept.process is process else kept

    def _drop(self, asset: str, name: str) -> None:
        kept = self._kept.get(asset, {}).pop(name, None)
        if kept is not None:
            self._used -= kept.positions.nbytes
            if not self._kept[asset]:
                del self._kept[asset]
