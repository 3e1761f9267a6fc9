"""Reports what the threads of the device do now, in memory that another process reads.

A call of an OpenCL driver cannot be cancelled, and a fault in one ends its process. The process
that watches sees here when a call takes too long, and which request or job the driver worked for.
Nothing is written before `report_to`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

NANOSECONDS = 1_000_000_000
# Seconds that the driver may compile a program, which takes longer than any launch.
COMPILING = 600.0
# Threads that may be in calls at a time, those that compile too; others are not told of.
_SLOTS = 63
# Places of each: when its call must have ended, in nanoseconds of the monotonic clock, 0 between
# two calls; the request, or the asset of the job, of its last call; the number of that call.
_DEADLINE, _REQUEST, _ASSET, _NUMBER = range(4)
_SLOT = 4
# Bytes of a report: how many calls have ended, and the slots.
SIZE = 8 * (1 + _SLOTS * _SLOT)


@dataclass(frozen=True)
class Purpose:
    """The request, by its number, or the job, by the number of its asset, that the driver works
    for; 0 for none."""

    request: int = 0
    asset: int = 0


class Report:
    """Numbers of 64 bits in `memory`, which the process that watches maps, too: a slot for each
    thread that is in a call, so that no call hides how long another takes."""

    def __init__(self, memory: memoryview) -> None:
        self._places = memory[:SIZE].cast("B").cast("Q")
        self._lock, self._mine = threading.Lock(), threading.local()
        self._free = list(range(1, len(self._places), _SLOT))[::-1]
        self._begun = 0

    @property
    def purpose(self) -> Purpose:
        """The purpose of the call that is late for longest. Where none is late, of the call that
        began last among those that have not ended, or among all."""
        slots, now = range(1, len(self._places), _SLOT), time.monotonic_ns()
        due = [(self._places[at + _DEADLINE], at) for at in slots]
        late = [(by, at) for by, at in due if 0 < by < now]
        within = [at for by, at in due if by] or slots
        at = min(late)[1] if late else max(within, key=lambda at: self._places[at + _NUMBER])
        return Purpose(self._places[at + _REQUEST], self._places[at + _ASSET])

    @property
    def ended(self) -> int:
        """How many calls of the driver have ended."""
        return self._places[0]

    @property
    def late(self) -> bool:
        """Whether a call of the driver takes longer than it may."""
        now = time.monotonic_ns()
        return any(0 < by < now for by in self._places[1 + _DEADLINE :: _SLOT])

    def begin(self, purpose: Purpose, seconds: float) -> None:
        """A call of the driver begins on this thread; it may take `seconds`."""
        with self._lock:
            at = getattr(self._mine, "at", None)  # one call within another
            if at is None and not self._free:
                return
            at = self._mine.at = self._free.pop() if at is None else at
            self._begun += 1
            self._places[at + _REQUEST], self._places[at + _ASSET] = purpose.request, purpose.asset
            self._places[at + _NUMBER] = self._begun
            self._places[at + _DEADLINE] = time.monotonic_ns() + int(seconds * NANOSECONDS)

    def end(self) -> None:
        """The call of the driver on this thread has ended."""
        with self._lock:
            at = self._mine.__dict__.pop("at", None)
            if at is not None:
                self._places[at + _DEADLINE] = 0
                self._free.append(at)
            self._places[0] += 1


_NOTHING = Purpose()
_purpose: ContextVar[Purpose] = ContextVar("purpose", default=_NOTHING)
_tell: ContextVar[Callable[[], None] | None] = ContextVar("tell", default=None)
_report: Report | None = None
_limit = 0.0


def report_to(report: Report, seconds: float) -> None:
    """Write every call of the driver to a report from now on.  seconds: that a call may take."""
    global _report, _limit
    _report, _limit = report, seconds


@contextmanager
def used_for(purpose: Purpose) -> Iterator[None]:
    """Calls of the driver by this thread in the block have this purpose."""
    token = _purpose.set(purpose)
    try:
        yield
    finally:
        _purpose.reset(token)


@contextmanager
def telling_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Have `tell` called whenever work of the block begins to wait for a program to be compiled, on
    the thread that waits. It must not block."""
    token = _tell.set(tell)
    try:
        yield
    finally:
        _tell.reset(token)


def tell_of_compiling() -> None:
    """The work of this thread begins to wait for a program to be compiled."""
    if (tell := _tell.get()) is not None:
        tell()


@contextmanager
def driver_call() -> Iterator[None]:
    """`begin_call` and `end_call` around a block."""
    begin_call()
    try:
        yield
    finally:
        end_call()


def begin_call() -> None:
    """A call of the driver begins; `end_call` follows."""
    if _report is not None:
        _report.begin(_purpose.get(), _limit)


def begin_compiling() -> None:
    """A call of the driver that compiles begins, which may take longer; `end_call` follows."""
    if _report is not None:
        _report.begin(_purpose.get(), max(_limit, COMPILING))


def end_call() -> None:
    """The call of the driver has ended."""
    if _report is not None:
        _report.end()
