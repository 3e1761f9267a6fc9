"""Greedy decisions in rounds: a thing is decided as soon as no earlier one that matters waits."""

from __future__ import annotations

from typing import Any

import numpy as np

from rhytid.device.runtime import Buffer
from rhytid.synthesis.workspace import Workspace

WAITING, KEPT, DROPPED, NEEDED = 0, 1, 2, 3


def until_decided(
    work: Workspace,
    program: str,
    kernel: str,
    count: int,
    arguments: tuple[Any, ...],
    states: int,
) -> Buffer:
    """Run the rounds of a kernel, whose last arguments are (before, after, waiting), to the end.

    Answers the states (states,) uint8: KEPT or DROPPED of all that the kernel goes over. Takes
    O(log count) rounds where priorities are random.
    """
    before, after = (work.full(states, np.uint8(WAITING)) for _ in range(2))
    while True:
        waiting = work.full(1, np.int32(0))
        work.run(program, kernel, count, *arguments, before, after, waiting)
        undecided = work.read(waiting, (1,), np.int32)[0]
        work.release(waiting)
        before, after = after, before
        if not undecided:
            work.release(after)
            return before
