"""What the thread of the device does now, written to memory that another process reads.

A call of an OpenCL driver cannot be cancelled, and a fault in one ends its process. Whoever watches
the process sees by this when a call takes too long, and which request or job the driver worked for.
Without `report_to` nothing is written.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

NANOSECONDS = 1_000_000_000
# Seconds that the driver may compile a program, which takes longer than any launch.
COMPILING = 600.0
# Bytes of a report.
SIZE = 4 * 8
# Places in it: when the present call must have ended, in nanoseconds of the monotonic clock, 0
# between two calls; how many have ended; the request, or the asset of the job, of the last call.
_DEADLINE, _ENDED, _REQUEST, _ASSET = range(4)


@dataclass(frozen=True)
class Purpose:
    """What the device is used for: a request by its number, or a job by the number of its asset; 0
    for none."""

    request: int = 0
    asset: int = 0


class Report:
    """Four numbers of 64 bits in `memory`, which the process that watches has, too."""

    def __init__(self, memory: memoryview) -> None:
        self._places = memory[:SIZE].cast("B").cast("Q")

    @property
    def purpose(self) -> Purpose:
        """What the last call of the driver was for."""
        return Purpose(self._places[_REQUEST], self._places[_ASSET])

    @property
    def ended(self) -> int:
        """Calls of the driver that have ended."""
        return self._places[_ENDED]

    @property
    def late(self) -> bool:
        """Whether the driver has not come back from a call in the time that it had."""
        return 0 < self._places[_DEADLINE] < time.monotonic_ns()

    def begin(self, purpose: Purpose, seconds: float) -> None:
        """A call of the driver begins, which may take so long."""
        self._places[_REQUEST], self._places[_ASSET] = purpose.request, purpose.asset
        self._places[_DEADLINE] = time.monotonic_ns() + int(seconds * NANOSECONDS)

    def end(self) -> None:
        """It has come back."""
        self._places[_DEADLINE] = 0
        self._places[_ENDED] += 1

    def clear(self) -> None:
        """Forget everything."""
        for place in range(len(self._places)):
            self._places[place] = 0


_NOTHING = Purpose()
_purpose: ContextVar[Purpose] = ContextVar("purpose", default=_NOTHING)
_report: Report | None = None
_limit = 0.0


def report_to(report: Report, seconds: float) -> None:
    """From now on tell of every call of the driver.  seconds: that one may take."""
    global _report, _limit
    _report, _limit = report, seconds


@contextmanager
def used_for(purpose: Purpose) -> Iterator[None]:
    """What this thread asks of the device in the block is for this."""
    token = _purpose.set(purpose)
    try:
        yield
    finally:
        _purpose.reset(token)


@contextmanager
def driver_call() -> Iterator[None]:
    """`begin_call` and `end_call` around a block."""
    begin_call()
    try:
        yield
    finally:
        end_call()


def begin_call() -> None:
    """The driver is called; `end_call` follows."""
    if _report is not None:
        _report.begin(_purpose.get(), _limit)


def begin_compiling() -> None:
    """The driver is called to compile, for which it has longer; `end_call` follows."""
    if _report is not None:
        _report.begin(_purpose.get(), max(_limit, COMPILING))


def end_call() -> None:
    """The driver has come back."""
    if _report is not None:
        _report.end()
