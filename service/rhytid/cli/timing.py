"""How long the steps of a command take."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rhytid.cli.reporting import table

HEADER = ("step", "times", "total s", "mean ms")


@dataclass
class Stopwatch:
    """Seconds of every call of a step, by the name of the step, in the order of first use."""

    seconds: dict[str, list[float]] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the block as one call of a step; one that fails is not counted."""
        start = time.perf_counter()
        yield
        self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Count one call."""
        self.seconds.setdefault(name, []).append(seconds)

    def figures(self) -> dict[str, dict[str, float]]:
        """Calls and seconds by step, for JSON."""
        return {
            name: {"calls": len(spent), "seconds": round(sum(spent), 6)}
            for name, spent in self.seconds.items()
        }

    def table(self) -> str:
        """The same for people."""
        rows = [
            (name, len(spent), f"{sum(spent):.2f}", f"{1000 * sum(spent) / len(spent):.0f}")
            for name, spent in self.seconds.items()
        ]
        return table(HEADER, rows)
