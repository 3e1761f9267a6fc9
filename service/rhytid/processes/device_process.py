"""One process of a device, as the server sees it: from its start to its end, and why it ended."""

from __future__ import annotations

import logging
import mmap
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from typing import Any

from rhytid.device.watch import SIZE, Purpose, Report
from rhytid.engine import changes
from rhytid.engine.changes import Changes
from rhytid.processes.interpreter import next_interpreter
from rhytid.processes.lines import Line, Lines
from rhytid.processes.packing import mapped, shared_file
from rhytid.processes.wire import Close, Control, OpenLine, Start, Started, close_all, readable

_FAULTS = {signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE, signal.SIGILL}
if hasattr(signal, "SIGBUS"):
    _FAULTS.add(signal.SIGBUS)


@dataclass(frozen=True)
class Ending:
    """Why a process is no more.

    kind: fault, one of its own; late, a call of the driver took too long; killed, from elsewhere.
    reason: in words.  purpose: what the driver worked for.
    """

    kind: str
    reason: str
    purpose: Purpose

    @property
    def blames(self) -> bool:
        """Whether what the driver worked for may have caused it."""
        return self.kind in ("fault", "late")


def ending_of(status: int, late: float | None, purpose: Purpose) -> Ending:
    """Of a process with this exit status.  late: seconds that a call of the driver had, where the
    process was ended because they were over."""
    if late is not None:
        reason = f"a call of the OpenCL driver took more than {late:g} seconds"
        return Ending("late", reason, purpose)
    if status >= 0:
        return Ending("fault", f"it ended with status {status}", purpose)
    name = signal.Signals(-status).name
    kind = "fault" if -status in _FAULTS else "killed"
    return Ending(kind, f"it ended by {name}", purpose)


_log = logging.getLogger(__name__)
# Seconds between two looks at what the process does.
LOOK = 0.1
# Seconds that it has to end by itself once it is asked to, and to answer once it is started.
CLOSING, STARTING = 4.0, 600.0
# Bytes of the memory for its report and, after that, for the counts of what it changes.
SHARED = mmap.PAGESIZE + changes.SIZE


class DeviceProcess:
    """A process with an engine, and the lines to it.

    on_message: called with its messages beside answers.  on_ready: called once it answers calls.
    figures_memory: descriptor of the memory for its figures, which stays the caller's.
    started: done once it answers; has the error where it does not start.  ending: set by whoever
    called `watch`, after it returned. `watch` must run for as long as the process lives, on the
    thread that made it: the system ends the process together with that thread.
    """

    def __init__(
        self,
        start: Start,
        on_message: Callable[[Any], None],
        on_ready: Callable[[DeviceProcess], None],
        figures_memory: int,
    ) -> None:
        self.started: Future[None] = Future()
        self.ending: Future[Ending] = Future()
        self._limit, self._on_message = start.settings.launch_seconds, on_message
        self._on_ready = on_ready
        memory = shared_file(SHARED)
        try:
            shared = mapped(memory, SHARED).data
            self.report = Report(shared[:SIZE])
            self.changes = Changes(shared[mmap.PAGESIZE :])
            interpreter = next_interpreter()
            self._process = interpreter.process
            self._control = Control(interpreter.control)
            with suppress(OSError):  # it has ended already: `watch` reports it
                self._control.send(start, memory, figures_memory)
        finally:
            os.close(memory)
        self.lines = Lines(self._new_line)
        self._answers_by = time.monotonic() + STARTING
        self._late: float | None = None
        self._unanswered = False
        self._close_by: float | None = None

    @property
    def pid(self) -> int:
        """Its number in the system."""
        return self._process.pid

    def close(self) -> None:
        """Ask it to end; it is killed where that takes too long."""
        if self._close_by is None:
            self._close_by = time.monotonic() + CLOSING
            with suppress(OSError):
                self._control.send(Close())

    def kill(self) -> None:
        """End it now."""
        self._process.kill()

    def watch(self) -> Ending:
        """Wait for its end, and end it where a call of the driver takes too long."""
        try:
            while self._handle_message():
                if self._late is None and self._is_late():
                    self.kill()
                if self._close_by is not None and time.monotonic() > self._close_by:
                    self.kill()
        except Exception:  # noqa: BLE001 else nobody would start it again
            _log.exception("the process of the device (%d) cannot be watched", self.pid)
        self.kill()  # it has closed its control socket, so that nothing can be asked of it
        ending = ending_of(self._process.wait(), self._late, self.report.purpose)
        if self._unanswered:
            reason = f"it did not answer within {STARTING:g} seconds of its start"
            ending = replace(ending, kind="killed", reason=reason)
        self._control.close()
        self.lines.close()
        return ending

    def _is_late(self) -> bool:
        """Whether it takes longer than it may, which is noted."""
        if self.report.late:
            self._late = self._limit
        elif not self.started.done() and time.monotonic() > self._answers_by:
            self._unanswered = True
        return self._late is not None or self._unanswered

    def _handle_message(self) -> bool:
        """Handle a message of the process, if one comes within LOOK; False where it is gone."""
        if not readable(self._control.line, LOOK):
            return True
        received = self._control.receive()
        if received is None:
            return False
        message, descriptors = received
        close_all(descriptors)
        if isinstance(message, Started):
            if message.error is None:
                self.started.set_result(None)
                self._on_ready(self)
            else:
                self.started.set_exception(message.error)
        else:
            self._on_message(message)
        return True

    def _new_line(self) -> Line:
        near, far = Pipe()
        with far, suppress(OSError):  # else the line is broken, which its user finds
            self._control.send(OpenLine(), far.fileno())
        return Line(near)
