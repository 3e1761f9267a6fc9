"""What every implementation of a case has: a run, and its result."""

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
        """Run it once, to its end; the result stays where it was made."""
        ...

    def result(self) -> Floats:
        """The result of the last run, on the host, as of FrameBench.result."""
        ...

    def release(self) -> None:
        """Release everything."""
        ...


@dataclass
class HostRun:
    """A function that leaves its result in the host's memory."""

    work: Callable[[], Floats]
    made: Floats | None = None

    def run(self) -> None:
        """Call the function."""
        self.made = self.work()

    def result(self) -> Floats:
        """Its result."""
        assert self.made is not None
        return self.made

    def release(self) -> None:
        """Forget its result."""
        self.made = None
