"""Which of the worn edges become wrinkles."""

from __future__ import annotations

import numpy as np

from rhytid.synthesis.edges import Edges
from rhytid.synthesis.independent import independent_set
from rhytid.synthesis.paths import rank_at
from rhytid.synthesis.surface import FloatArray, IntArray

# Every pore keeps so many of its edges before the strength alone decides: polygons close, and
# no wrinkle ends nowhere.
ENDS = 3


def preference(pores: int, edges: Edges, strength: FloatArray, crossings: IntArray) -> IntArray:
    """(E,) indices of the edges in the order in which they are wanted.

    First those that belong to the strongest of a pore and cross nothing stronger, then the others
    that cross nothing stronger, then the rest; by strength in each.
    """
    by_strength = np.argsort(-strength, kind="stable")
    rank = np.empty(len(edges), np.int64)
    rank[by_strength] = np.arange(len(edges))
    clear = independent_set(len(edges), rank[crossings])
    flat, crossing = by_strength[clear], by_strength[~clear]
    place = rank_at(edges.nodes[flat].ravel(), pores).reshape(-1, 2).min(axis=1)
    needed = place < ENDS
    return np.concatenate([flat[needed], flat[~needed], crossing])
