"""For each thing the pairs that it is in. Kernels: incidence.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Incidence:
    """Lists over N things of P pairs, on the device.

    offsets (N + 1,): where the list of each thing starts.  pairs, others (2P,): the numbers of its
    pairs, ascending, and who is the other in each.
    """

    entries: int
    offsets: Buffer
    pairs: Buffer
    others: Buffer

    @classmethod
    def of(cls, work: Workspace, members: Buffer, pairs: int, things: int) -> Incidence:
        """Lists of pairs, members (P, 2) int32, of so many things."""
        entries = 2 * pairs
        degree = work.full(things, np.int32(0))
        work.run("incidence", "count_pairs", entries, members, degree)
        starts = starts_of(work.read(degree, (things,), np.int32))
        work.release(degree)
        offsets, cursor = work.upload(starts), work.upload(starts)
        listed, others = work.empty(entries, np.int32), work.empty(entries, np.int32)
        work.run("incidence", "list_pairs", entries, members, cursor, listed)
        work.run("incidence", "sort_pairs", things, offsets, members, listed, others)
        work.release(cursor)
        return cls(entries, offsets, listed, others)


def starts_of(counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """(N + 1,) where each of lists of these lengths (N,) starts, and where the last ends."""
    starts = np.zeros(len(counts) + 1, np.int32)
    np.cumsum(counts, out=starts[1:])
    return starts
