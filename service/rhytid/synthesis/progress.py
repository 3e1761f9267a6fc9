"""Long work: reports of its progress, and arrays in blocks of rows, between which it may stop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from rhytid.support import cancellation

Progress = Callable[[float, str], None]
ROWS = 1 << 19


def silent(fraction: float, stage: str) -> None:
    """Report nothing."""


def part(progress: Progress, low: float, high: float) -> Progress:
    """The progress, from 0 to 1, of a part that runs from `low` to `high` of the whole."""

    def report(fraction: float, stage: str) -> None:
        progress(low + (high - low) * fraction, stage)

    return report


def rising(progress: Progress) -> Progress:
    """A progress that passes reports on to another, none below the one before."""
    reached = 0.0

    def report(fraction: float, stage: str) -> None:
        nonlocal reached
        reached = max(fraction, reached)
        progress(reached, stage)

    return report


def clocked(progress: Progress) -> tuple[Progress, dict[str, float]]:
    """A progress that passes reports on to another, and the seconds of each stage by its name,
    which fill as reports come."""
    seconds: dict[str, float] = {}
    last: list[tuple[str, float]] = []

    def report(fraction: float, stage: str) -> None:
        now = time.perf_counter()
        if last:
            before, since = last.pop()
            seconds[before] = round(seconds.get(before, 0.0) + now - since, 6)
        last.append((stage, now))
        progress(fraction, stage)

    return report, seconds


def row_blocks(count: int) -> Iterator[slice]:
    """The rows 0 to `count`, ROWS at a time. Raises what `stopping.check` does, before each
    block."""
    for first in range(0, count, ROWS):
        cancellation.check()
        yield slice(first, min(first + ROWS, count))
