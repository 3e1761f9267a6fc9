"""SIGINT and SIGTERM as exceptions, so that temporary folders, stores and devices are released.

A command ends within a second of SIGINT. Python runs a handler only between two of its own
instructions, and a call into a driver may take longer than that. So a thread watches for the
signal, too, and ends the process where the exception has not done so in time.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

from rhytid.support.temporary_folders import remove_temporary_folders

INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
# Seconds that a command has to end by itself after SIGINT.
GRACE = 0.5


class Terminated(SystemExit):
    """Raised at SIGTERM."""


class Interruption:
    """The state of an interruption by SIGINT, and of a termination by SIGTERM.

    came, terminated: whether SIGINT came, and SIGTERM.  command: name of the command, once the
    arguments are read.
    """

    def __init__(self) -> None:
        self.came = self.terminated = False
        # The name of the command, once the arguments have been read.
        self.command = ""
        self._said = threading.Lock()

    def say(self) -> None:
        """Print one line on stderr, once."""
        if self._said.acquire(blocking=False):
            program = f"rhytid {self.command}".rstrip()
            cancelled = self.terminated and not self.came
            what = "cancelled by SIGTERM" if cancelled else "interrupted"
            print(f"{program}: {what}", file=sys.stderr, flush=True)

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """The handler of SIGINT. Raises KeyboardInterrupt, once."""
        if not self.came:
            self.came = True
            raise KeyboardInterrupt

    def terminate(self, number: int, frame: FrameType | None) -> None:
        """The handler of SIGTERM. Raises Terminated."""
        self.terminated = True
        raise Terminated(TERMINATED)


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Within the block, SIGINT raises KeyboardInterrupt, and ends the process if the block has not
    ended soon after. SIGTERM raises Terminated. Does nothing outside of the main thread."""
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
    try:
        while came := os.read(reading, 1):
            if came[0] == signal.SIGINT and not ended.wait(GRACE):
                with suppress(OSError, ValueError):
                    found.say()
                end_now(INTERRUPTED)
    finally:
        os.close(reading)


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
