"""Progress of long work: a call that may raise CancelledError."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

Progress = Callable[[float, str], None]


def silent(fraction: float, stage: str) -> None:
    """Report nothing."""


def part(progress: Progress, low: float, high: float) -> Progress:
    """Progress from 0 to 1 of a part that runs from `low` to `high` of the whole."""

    def report(fraction: float, stage: str) -> None:
        progress(low + (high - low) * fraction, stage)

    return report


class Clock:
    """Passes reports on, none below the one before, and adds up how long each stage takes.

    A report says what is done next: time until the following report is its stage's.
    """

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._stage, self._since = progress, "", perf_counter()
        self._reached = 0.0

    def __call__(self, fraction: float, stage: str) -> None:
        """Take the time and report."""
        now = perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = stage, now
        self._reached = max(fraction, self._reached)
        self._progress(self._reached, stage)
