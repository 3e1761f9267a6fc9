"""What every implementation of a case gives: something to run, and what it made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rhytid_lab.bench.scene import Floats


class LeftOut(Exception):
    """Why an implementation is not timed here."""


class Run(Protocol):
    """One case of one implementation, with all that stays from frame to frame made already."""

    def run(self) -> None:
        """Do it once, to its end; what it makes stays where it was made."""
        ...

    def result(self) -> Floats:
        """What the last run made, on the host, as FrameBench.result has it."""
        ...

    def release(self) -> None:
        """Give everything back."""
        ...


@dataclass
class HostRun:
    """A function that leaves its result in the host's memory."""

    work: Callable[[], Floats]
    made: Floats | None = None

    def run(self) -> None:
        """Call it."""
        self.made = self.work()

    def result(self) -> Floats:
        """What it gave."""
        assert self.made is not None
        return self.made

    def release(self) -> None:
        """Forget what it gave."""
        self.made = None
