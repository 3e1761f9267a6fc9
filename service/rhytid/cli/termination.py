"""SIGINT and SIGTERM as exceptions, so that temporary folders, stores and devices are released.

A command ends within a second of SIGINT. After SIGTERM it has longer, to finish the files that it
is writing, and a SIGTERM a second later or more ends that at once. Python runs a handler only
between two of its own instructions, and a call into a driver may take longer than that. So a thread
watches for the signals, too, and ends the process where the exception has not done so in time. No
file is half written then: what is not finished is dropped, and said.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

from rhytid.support.atomic_files import being_written
from rhytid.support.temporary_folders import remove_temporary_folders

INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
# Seconds that a command has to end by itself after SIGINT; and after SIGTERM, which is less than
# the schedulers of render farms wait before they send SIGKILL.
GRACE, PATIENCE = 0.5, 8.0
# Seconds after SIGTERM from which another one asks for an end at once. GNU `timeout` sends two, to
# its child and to the group of that.
AGAIN = 1.0
# Unfinished files that are named.
_NAMED = 8


class Terminated(SystemExit):
    """Raised at SIGTERM."""


class Interruption:
    """The state of an interruption by SIGINT, and of a termination by SIGTERM. Which of them came
    first decides what is said, and the exit status.

    came, terminated: whether SIGINT came, and SIGTERM.  command: name of the command, once the
    arguments are read.
    """

    def __init__(self) -> None:
        self.came = self.terminated = False
        self._first = 0
        self.command = ""
        self._said = threading.Lock()

    def note(self, number: int) -> None:
        """Note that a signal has come. The thread that watches may hear of it before a handler
        runs."""
        self._first = self._first or number

    @property
    def status(self) -> int:
        """The exit status of what is ended by the first signal."""
        return TERMINATED if self._first == signal.SIGTERM else INTERRUPTED

    def say(self, dropped: Sequence[str] = ()) -> None:
        """Print one line on stderr, once; before it one that names the files that are dropped."""
        if self._said.acquire(blocking=False):
            program = f"rhytid {self.command}".rstrip()
            if dropped:
                more = f" and {len(dropped) - _NAMED} more" if len(dropped) > _NAMED else ""
                named = ", ".join(dropped[:_NAMED])
                print(f"{program}: dropped, not finished: {named}{more}", file=sys.stderr)
            what = "cancelled by SIGTERM" if self.status == TERMINATED else "interrupted"
            print(f"{program}: {what}", file=sys.stderr, flush=True)

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """The handler of SIGINT. Raises KeyboardInterrupt, once."""
        self.note(number)
        if not self.came:
            self.came = True
            raise KeyboardInterrupt

    def terminate(self, number: int, frame: FrameType | None) -> None:
        """The handler of SIGTERM. Raises Terminated, once."""
        self.note(number)
        if not self.terminated:
            self.terminated = True
            raise Terminated(self.status)


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Within the block, SIGINT raises KeyboardInterrupt and SIGTERM raises Terminated, and the
    process is ended if the block has not ended soon after, or when SIGTERM comes again AGAIN
    seconds later. Does nothing outside of the main thread."""
    found = Interruption()
    here = threading.current_thread() is threading.main_thread()
    if not here or not hasattr(os, "set_blocking"):  # Windows has it from Python 3.12 on
        yield found
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    ended = threading.Event()
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, found.interrupt),
        signal.SIGTERM: signal.signal(signal.SIGTERM, found.terminate),
    }
    woken = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    arguments = (reading, ended, found)
    threading.Thread(target=_watch, args=arguments, name="rhytid-interrupt", daemon=True).start()
    try:
        yield found
    finally:
        ended.set()
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(writing)


def _watch(reading: int, ended: threading.Event, found: Interruption) -> None:
    """Read numbers of signals until the other end is closed."""
    asked: float | None = None
    try:
        while came := os.read(reading, 1):
            if came[0] == signal.SIGINT:
                found.note(signal.SIGINT)
                _end_after(GRACE, ended, found)
            elif came[0] == signal.SIGTERM and _is_ours(found):
                found.note(signal.SIGTERM)
                last = PATIENCE, ended, found
                if asked is None:
                    asked = time.monotonic()
                    threading.Thread(target=_end_after, args=last, daemon=True).start()
                elif time.monotonic() >= asked + AGAIN:
                    _end_after(0.0, *last[1:])
    finally:
        os.close(reading)


def _is_ours(found: Interruption) -> bool:
    """Whether SIGTERM is for the command, not for a server that drains within it."""
    return signal.getsignal(signal.SIGTERM) == found.terminate


def _end_after(seconds: float, ended: threading.Event, found: Interruption) -> None:
    """End the process unless the block ends before."""
    if not ended.wait(seconds):
        with suppress(OSError, ValueError):
            found.say([file.name for file in being_written()])
        end_now(found.status)


def end_now(status: int) -> NoReturn:
    """End the process without waiting for its threads. Unfinished files are removed."""
    try:
        remove_temporary_folders()
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):  # the reader is closed, too
        pass
    finally:
        os._exit(status)
