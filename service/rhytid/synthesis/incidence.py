"""Lists of the pairs that each thing is in, and greedy choices of things of which no two are a
pair. Kernels: incidence.cl, independent.cl.

A thing is chosen or dropped as soon as no earlier one that it conflicts with waits: the answer is
that of a loop over all of them in order, in a few rounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.workspace import Workspace

# Lists whose lengths a thread adds up at a time.
_EACH = 1 << 18
WAITING, KEPT, DROPPED, NEEDED = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class Incidence:
    """Lists over N things of P pairs, on the device.

    offsets (N + 1,): where the list of each thing starts.  pairs, others (2P,): the numbers of its
    pairs, ascending, and the other thing in each.
    """

    entries: int
    offsets: Buffer
    pairs: Buffer
    others: Buffer

    @classmethod
    def of(cls, work: Workspace, members: Buffer, pairs: int, things: int) -> Incidence:
        """The lists of so many things.  members (P, 2) int32: the two things of each pair."""
        entries = 2 * pairs
        degree = work.readable(things, np.int32, zero=True)
        work.run("incidence", "count_pairs", entries, members, degree)
        starts = starts_of(work.read(degree, (things,), np.int32))
        work.release(degree)
        offsets, cursor = work.lend(starts), work.upload(starts)
        listed, others = work.empty(entries, np.int32), work.empty(entries, np.int32)
        work.run("incidence", "list_pairs", entries, members, cursor, listed)
        work.run("incidence", "sort_pairs", things, offsets, members, listed, others)
        work.release(cursor)
        return cls(entries, offsets, listed, others)


def starts_of(counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """(N + 1,) where each list starts, and where the last one ends.  counts (N,): their lengths."""
    starts, sums = np.zeros(len(counts) + 1, np.int32), np.zeros(-(-len(counts) // _EACH), np.int64)

    def add_up(rows: slice) -> None:
        after = starts[1:][rows]
        np.cumsum(counts[rows], dtype=np.int32, out=after)  # by itself numpy goes over eight bytes
        sums[rows.start // _EACH] = after[-1]

    over_rows(len(counts), add_up, _EACH)
    before = np.cumsum(sums) - sums

    def move(rows: slice) -> None:
        starts[1:][rows] += np.int32(before[rows.start // _EACH])

    over_rows(len(counts), move, _EACH)
    return starts


def until_decided(
    work: Workspace,
    program: str,
    kernel: str,
    count: int,
    arguments: tuple[Any, ...],
    states: int,
) -> Buffer:
    """Run a kernel round after round until nothing waits.

    The last arguments of the kernel are (before, after, waiting). Returns the states (states,)
    uint8, on the device: KEPT or DROPPED for all that the kernel goes over. It takes O(log count)
    rounds where priorities are random.
    """
    before, after = (work.readable(states, np.uint8, zero=True) for _ in range(2))  # WAITING
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
    """(count,) whether a greedy pass in the order of (key, number) keeps each thing.

    key: (count,).  pairs: (P, 2) conflicts, in any order. The result is that of the sequential loop
    "keep a thing unless an earlier kept one conflicts with it".
    """
    with work.nested() as nested:
        lists = Incidence.of(nested, nested.lend(pairs), len(pairs), len(key))
        state = chosen(nested, nested.lend(key), len(key), lists)
        kept: NDArray[np.bool_] = nested.read(state, (len(key),), np.uint8) == KEPT
    return kept


def chosen(work: Workspace, key: Buffer, count: int, conflicts: Incidence) -> Buffer:
    """(count,) uint8 on the device: KEPT or DROPPED."""
    arguments = (key, conflicts.offsets, conflicts.others)
    return until_decided(work, "independent", "decide", count, arguments, count)
