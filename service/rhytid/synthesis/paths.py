"""The candidate wrinkles as walkers see them: the ways out of each pore."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.surface import FloatArray, IntArray, Points

Table = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Paths:
    """For each pore (N) its ways out (D slots; where there are fewer, the edge is E).

    edge (N, D): index of the edge.  to (N, D): the pore at its end.
    back (N, D): the slot of the same edge at that pore.
    cosine, sine (N, D): the angle of the way out against the preferred direction of the pore.
    """

    edge: IntArray
    to: IntArray
    back: IntArray
    cosine: Table
    sine: Table

    @classmethod
    def of(cls, pores: Points, nodes: IntArray, along: FloatArray, left: FloatArray) -> Paths:
        """Lay out edges `nodes` (E, 2); `along`, `left` (N, 3) is the frame of each pore."""
        edges = len(nodes)
        source, target = nodes.T.ravel(), nodes[:, ::-1].T.ravel()
        slot = rank_at(source, len(pores))
        way = pores.position[target] - pores.position[source]
        x = np.einsum("hx,hx->h", way, along[source])
        y = np.einsum("hx,hx->h", way, left[source])
        norm = np.hypot(x, y)
        shape = (len(pores), int(slot.max(initial=0)) + 1)

        def table(values: NDArray[np.generic], blank: int, kind: type[np.generic]) -> NDArray[Any]:
            filled = np.full(shape, blank, kind)
            filled[source, slot] = values
            return filled

        return cls(
            edge=table(np.tile(np.arange(edges), 2), edges, np.int64),
            to=table(target, 0, np.int64),
            back=table(np.roll(slot, edges), 0, np.int64),
            cosine=table(x / norm, 1, np.float32),
            sine=table(y / norm, 0, np.float32),
        )


def rank_at(source: IntArray, count: int) -> IntArray:
    """(H,) how many earlier entries of `source` (H,) name the same of `count` pores."""
    order = np.argsort(source, kind="stable")
    degree = np.bincount(source, minlength=count)
    rank = np.empty(len(source), np.int64)
    rank[order] = np.arange(len(source)) - np.repeat(np.cumsum(degree) - degree, degree)
    return rank
