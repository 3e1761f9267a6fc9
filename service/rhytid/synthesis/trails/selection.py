"""Which of the worn edges become wrinkles. Kernel: independent.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.edges.candidate_graph import CandidateGraph
from rhytid.synthesis.edges.edges import Edges
from rhytid.synthesis.edges.incidence import Incidence
from rhytid.synthesis.edges.rounds import KEPT, NEEDED, chosen
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.workspace import Workspace

# Every pore keeps so many of its edges before the strength alone decides: polygons close, and
# no wrinkle ends nowhere.
ENDS = 3


# Between the classes of edges: more than any strength.
_CLASS = 1024.0


@dataclass(frozen=True)
class Cut:
    """The least wanted edge that is drawn: its wish and length."""

    wish: float
    length: float = np.inf

    @classmethod
    def at(cls, edges: Edges, wish: NDArray[np.float64], count: int) -> Cut:
        """Where exactly `count` edges are drawn; of equal wishes the shorter ones first."""
        least = float(-np.partition(-wish, count - 1)[count - 1])
        tied = np.flatnonzero(wish == least)
        left = count - np.count_nonzero(wish > least)
        return cls(least, float(np.partition(edges.length[tied], left - 1)[left - 1]))

    def draws(self, edges: Edges, wish: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(E,) whether each edge is drawn; it hangs on the edge alone."""
        even = (wish == self.wish) & (edges.length <= self.length)
        drawn: NDArray[np.bool_] = (wish > self.wish) | even
        return drawn


def wishes(
    work: Workspace, net: CandidateGraph, strength: NDArray[np.float32], progress: Progress
) -> NDArray[np.float64]:
    """(E,) how much the edges of a net, of strength (E,), are wanted.

    Most those that belong to the strongest of a pore and cross nothing stronger, then the others
    that cross nothing stronger, then the rest; by strength in each.
    """
    mark = _marks(work, net, strength, progress)
    wish: NDArray[np.float64] = strength.astype(np.float64)
    wish[mark == KEPT] += _CLASS
    wish[mark == NEEDED] += 2.0 * _CLASS
    progress(1.0, "selection")
    return wish


def flat(strength: float) -> Cut:
    """What crosses nothing stronger and is as strong as this, and all that pores need."""
    return Cut(_CLASS + strength)


def _marks(
    work: Workspace, net: CandidateGraph, strength: NDArray[np.float32], progress: Progress
) -> NDArray[np.uint8]:
    """(E,) NEEDED, KEPT or DROPPED."""
    count, crossings = len(net.edges), net.crossings
    progress(0.0, "selection")
    with work.room() as room:
        key = room.upload(-strength)
        conflicts = Incidence.of(room, room.upload(crossings), len(crossings), count)
        progress(0.2, "selection")
        state = chosen(room, key, count, conflicts)
        progress(0.5, "selection")
        nodes, marked = room.upload(net.edges.nodes), room.empty(count, np.uint8)
        lists = Incidence.of(room, nodes, count, len(net.pores))
        progress(0.8, "selection")
        room.run(
            "independent", "mark_needed", count, ENDS, key, nodes, lists.offsets, lists.pairs,
            state, marked,
        )  # fmt: skip
        found: NDArray[np.uint8] = room.read(marked, (count,), np.uint8)
    return found
