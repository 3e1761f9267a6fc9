"""Greedy decisions in rounds: a thing is decided as soon as no earlier one that matters waits.
Kernel of independent sets: independent.cl."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.edges.incidence import Incidence
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


def independent_set(
    work: Workspace, key: NDArray[np.float32], pairs: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """(count,) true for the things that a greedy pass in the order of (key, number) keeps.

    key: (count,).  pairs: (P, 2) conflicts, in any order. The answer is that of the sequential loop
    "keep a thing unless an earlier kept one conflicts with it".
    """
    with work.room() as room:
        lists = Incidence.of(room, room.upload(pairs), len(pairs), len(key))
        state = chosen(room, room.upload(key), len(key), lists)
        kept: NDArray[np.bool_] = room.read(state, (len(key),), np.uint8) == KEPT
    return kept


def chosen(work: Workspace, key: Buffer, count: int, conflicts: Incidence) -> Buffer:
    """(count,) uint8 on the device: KEPT or DROPPED."""
    arguments = (key, conflicts.offsets, conflicts.others)
    return until_decided(work, "independent", "decide", count, arguments, count)
