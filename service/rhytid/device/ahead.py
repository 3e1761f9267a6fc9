"""Programs that the asset loaded last needed, built again at the next start before anybody asks.

Of a program that it has compiled before, PoCL still reads the source: some 50 ms of the processor
each, and an asset needs a dozen. A server that waits for its first request builds them meanwhile.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rhytid.device.runtime import Device
from rhytid.device.select import recall, remember
from rhytid.errors import RhytidError

_FILE = "programs.json"


class ProgramsAhead:
    """Builds the programs of the last load in a thread of its own, from `begin` until `close`.

    folder: where they are remembered; None for nowhere.
    """

    def __init__(self, device: Device, folder: Path | None) -> None:
        self._device, self._closed = device, threading.Event()
        self._file = None if folder is None else folder / _FILE
        self._known = self._recalled()
        self._thread = threading.Thread(target=self._build, name="rhytid-programs", daemon=True)

    def begin(self) -> None:
        """Start building."""
        self._thread.start()

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Remember the programs whose kernels are launched in the block, in their order."""
        with self._device.programs.noting() as used:
            yield
        found = [[name, dict(defines)] for name, defines in used]
        if found != self._known:
            self._known = found
            self._remember(found)

    def close(self) -> None:
        """Build no more; waits for the program that is being built."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _recalled(self) -> list[Any]:
        found = {} if self._file is None else recall(self._file)
        known = found.get(self._device.info.identity)
        return known if isinstance(known, list) else []

    def _remember(self, programs: list[Any]) -> None:
        if self._file is not None:
            with suppress(TypeError):  # a define that JSON does not have
                remember(self._file, self._device.info.identity, programs)

    def _build(self) -> None:
        if not self._known:
            return
        known = self._known
        # Where a compiler ends the process, nothing is built ahead at the next start.
        self._remember([])
        for given in known:
            if self._closed.is_set():
                break
            # What another version remembered may not be there, nor compile: who needs it says so.
            with suppress(RhytidError, OSError, TypeError, ValueError, AttributeError):
                name, defines = given
                self._device.programs.prepare(name, defines)
        self._remember(self._known)
