"""Figures of a device, as numbers in memory that another process may read.

The process of a device writes them, the server reads them: nothing is sent for it, they can be read
while the device hangs, and the next process goes on counting where the last one ended.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import accumulate, product
from typing import TypeVar

T = TypeVar("T")
NANOSECONDS = 1_000_000_000
# Where the time of a request or a job goes, in the order of its way.
STAGES = ("upload", "decode", "queue", "kernel", "read_back", "encode")
# The work that the time is spent for: tiles and maps by method, jobs, and everything else.
WORK = ("neutral", "redraw", "binned", "convolved", "job", "other")
# Upper bounds of the histograms, in seconds.
BOUNDS = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
# Entries that are dropped when the memory of the device is short.
DROPPED = ("asset", "bins", "finest", "other")
# Kinds of jobs by priority, highest first; their states, and how they end.
JOB_KINDS = ("frames", "build", "calibration", "bins", "package", "fetch", "push")
JOB_STATES = ("queued", "running")
JOB_ENDS = ("done", "failed", "cancelled")

_BOUNDS = tuple(int(bound * NANOSECONDS) for bound in BOUNDS)
_Name = tuple[str, ...]
# Numbers that only grow, and those that a process that starts sets to 0.
_COUNTERS: tuple[_Name, ...] = (
    *(("dropped", what) for what in DROPPED),
    *(("ended", *names) for names in product(JOB_KINDS, JOB_ENDS)),
)
_GAUGES: tuple[_Name, ...] = (
    ("used",),
    ("spare",),
    ("limit",),
    *(("jobs", *names) for names in product(JOB_KINDS, JOB_STATES)),
)
_PLACES = {name: place for place, name in enumerate((*_COUNTERS, *_GAUGES))}
# Of a histogram: a number for each bound, one for what is above them, and the sum in nanoseconds.
_WIDTH = len(BOUNDS) + 2
_HISTOGRAMS = {
    name: len(_PLACES) + _WIDTH * n for n, name in enumerate(product(STAGES, WORK))
}  # fmt: skip
# Bytes of the memory.
SIZE = 8 * (len(_PLACES) + _WIDTH * len(_HISTOGRAMS))


@dataclass(frozen=True)
class Span:
    """A stage of one request.  start: nanoseconds since 1970."""

    stage: str
    start: int
    nanoseconds: int


_work: ContextVar[str] = ContextVar("work", default="other")
_spans: ContextVar[list[Span] | None] = ContextVar("spans", default=None)


@contextmanager
def working_on(work: str) -> Iterator[None]:
    """Time that is measured in the block counts for this kind of work, one of `WORK`."""
    token = _work.set(work if work in WORK else "other")
    try:
        yield
    finally:
        _work.reset(token)


def spent_on(work: str, call: Callable[[], T]) -> T:
    """Make a call in the block of `working_on`, and return its result."""
    with working_on(work):
        return call()


@contextmanager
def spans_of_request() -> Iterator[list[Span]]:
    """Collects the stages that are measured in the block, and in work that it hands to other
    threads."""
    found: list[Span] = []
    token = _spans.set(found)
    try:
        yield found
    finally:
        _spans.reset(token)


def spans_are_kept() -> bool:
    """Whether stages are collected now, by `spans_of_request`."""
    return _spans.get() is not None


def keep_spans(spans: Sequence[Span]) -> None:
    """Add the stages that another process measured of the present request."""
    found = _spans.get()
    if found is not None:
        found.extend(spans)


class Figures:
    """The numbers of a device; any thread of one process may write them, and another process read
    them.

    memory: `SIZE` bytes, all zero at first; None: memory of this process alone.
    """

    def __init__(self, memory: memoryview | None = None) -> None:
        whole = memoryview(bytearray(SIZE)) if memory is None else memory
        self._numbers = whole[:SIZE].cast("B").cast("Q")
        self._lock = threading.Lock()
        self._read_back = 0

    def begin(self) -> None:
        """Set every gauge to 0, since a process begins to write: it holds nothing and runs no job
        yet."""
        for name in _GAUGES:
            self.set(0, *name)

    def took(self, stage: str, nanoseconds: int) -> None:
        """Count a stage of the present work (`working_on`) that has just ended, with the time it
        took."""
        place = _HISTOGRAMS[stage, _work.get()]
        with self._lock:
            self._numbers[place + bisect_left(_BOUNDS, nanoseconds)] += 1
            self._numbers[place + _WIDTH - 1] += max(nanoseconds, 0)
        spans = _spans.get()
        if spans is not None:
            spans.append(Span(stage, time.time_ns() - nanoseconds, nanoseconds))

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Times a block that ends without an error."""
        start = time.perf_counter_ns()
        yield
        self.took(name, time.perf_counter_ns() - start)

    def read_back(self, nanoseconds: int) -> None:
        """Count time in which the task at work copied results to the host."""
        self._read_back += nanoseconds

    def task(self, task: Callable[[], T], queued: int) -> T:
        """Run a task of the device, and count its stages.  queued: when it was queued, by
        `perf_counter_ns`."""
        start, self._read_back = time.perf_counter_ns(), 0
        self.took("queue", start - queued)
        try:
            return task()
        finally:
            copied = self._read_back
            self.took("kernel", time.perf_counter_ns() - start - copied)
            if copied:
                self.took("read_back", copied)

    def count(self, *name: str) -> None:
        """Add one to a counter, such as `("dropped", "asset")`."""
        with self._lock:
            self._numbers[_PLACES[name]] += 1

    def set(self, value: int, *name: str) -> None:
        """Set a gauge, such as `("used",)`."""
        self._numbers[_PLACES[name]] = value

    def copied(self) -> bytes:
        """A copy of the memory."""
        return self._numbers.tobytes()

    def value(self, *name: str) -> int:
        """The number of a counter or a gauge."""
        return self._numbers[_PLACES[name]]

    def histogram(self, stage: str, work: str) -> tuple[list[int], float]:
        """How often a stage took at most each of `BOUNDS`, and how often it took any time; and the
        seconds that it took in all."""
        place = _HISTOGRAMS[stage, work]
        counts = self._numbers[place : place + _WIDTH].tolist()
        return list(accumulate(counts[:-1])), counts[-1] / NANOSECONDS
