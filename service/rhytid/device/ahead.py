"""Programs that the asset loaded last needed, and those that drew it since, built again at the next
start before anybody asks.

Of a program that it has compiled before, PoCL still reads the source: some 15 ms of the processor
each, and an asset needs a dozen. A server that waits for its first request builds them meanwhile.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import rhytid_kernels
from rhytid.device.runtime import Device
from rhytid.device.select import recall, remember
from rhytid.errors import RhytidError

_FILE = "programs.json"
# Stages whose programs are not built again: skin is grown, and scans are traced, once.
_ONCE = ("synthesis", "tracing")
# Programs that are remembered, at most: who changes settings again and again needs ever others.
_MOST = 40
# Marks those that drew after a load, and seconds that they are built after those of the load: the
# first request, which may come at once, needs these first.
_DREW, _LATER = "drew", 3.0


class ProgramsAhead:
    """Builds programs in a thread of its own, from `begin` until `close`: those of the last load,
    and those that drew since.

    folder: where they are remembered; None for nowhere.
    """

    def __init__(self, device: Device, folder: Path | None) -> None:
        self._device, self._closed = device, threading.Event()
        self._file = None if folder is None else folder / _FILE
        self._known = self._recalled()
        self._looked, self._lock = 0, threading.Lock()  # requests draw on several threads
        self._thread = threading.Thread(target=self._build, name="rhytid-programs", daemon=True)

    def begin(self) -> None:
        """Start building."""
        self._thread.start()

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Remember the programs whose kernels are launched in the block, in their order; those that
        drew after a load of the same programs stay."""
        self._device.programs.begin_noting()
        yield
        with self._lock:
            found = self._used()
            self._looked = len(self._device.programs.noted)
            if found != [one for one in self._known if not _drew(one)]:
                self._note(found)

    def note_drawn(self) -> None:
        """Remember what drawing has needed beside that; to be called after anything was drawn."""
        if len(self._device.programs.noted) == self._looked:
            return
        with self._lock:
            self._looked = len(self._device.programs.noted)
            known = [one[:2] for one in self._known]
            new = [[*one, _DREW] for one in self._used() if one not in known]
            if new and len(self._known) < _MOST:
                self._note([*self._known, *new][:_MOST])

    def _used(self) -> list[Any]:
        return [
            [name, dict(defines)]
            for name, defines in self._device.programs.noted
            if rhytid_kernels.stage(name) not in _ONCE
        ]

    def _note(self, programs: list[Any]) -> None:
        self._known = programs
        self._remember(programs)

    def close(self) -> None:
        """Build no more; waits for the program that is being built."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _recalled(self) -> list[Any]:
        found = {} if self._file is None else recall(self._file)
        known = found.get(self._device.info.identity)
        return [one for one in known if _is_program(one)] if isinstance(known, list) else []

    def _remember(self, programs: list[Any]) -> None:
        if self._file is not None:
            with suppress(TypeError):  # a define that JSON does not have
                remember(self._file, self._device.info.identity, programs)

    def _build(self) -> None:
        known = self._known
        self._prepare([given for given in known if not _drew(given)])
        later = [given for given in known if _drew(given)]
        if later and not self._closed.wait(_LATER):
            self._prepare(later)

    def _prepare(self, programs: list[Any]) -> None:
        if not programs:
            return
        # Where a compiler ends the process, nothing is built ahead at the next start.
        self._remember([])
        for given in programs:
            if self._closed.is_set():
                break
            # What another version remembered may not be there, nor compile: who needs it says so.
            with suppress(RhytidError, OSError, TypeError, ValueError, AttributeError):
                name, defines, *_ = given
                self._device.programs.prepare(name, defines)
        self._remember(self._known)


def _is_program(given: Any) -> bool:
    """Whether what a file has is a program as `_used` has it, and maybe a mark."""
    return (
        isinstance(given, list)
        and len(given) > 1
        and isinstance(given[0], str)
        and isinstance(given[1], dict)
    )


def _drew(given: Any) -> bool:
    """Whether a program is remembered as one that drew after a load."""
    return _DREW in given[2:]
