"""The model's prediction beside runs that were measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rhytid_lab.scaling.figures import Run
from rhytid_lab.scaling.model import Head, Model


@dataclass(frozen=True)
class Check:
    """A run and what was predicted of it, seconds.

    predicted: of one worker, and so of all, since each has a device.  processor: measured, the mean
    of the workers.  wall: measured.
    """

    run: Run
    predicted: float

    @property
    def processor(self) -> float:
        """Processor time of a worker."""
        return self.run.processor / self.run.workers

    @property
    def error(self) -> float:
        """Of the prediction against processor time: 0.1 is 10 % too long."""
        return self.predicted / self.processor - 1.0

    @property
    def wall_error(self) -> float:
        """Of the prediction against wall time."""
        return self.predicted / self.run.wall - 1.0


def check(model: Model, runs: Sequence[Run]) -> list[Check]:
    """What the model says of each run."""
    return [
        Check(
            run,
            model.bake(Head(run.size, run.wrinkles), run.method, run.frames, run.workers),
        )
        for run in runs
    ]
