"""Greedy independent sets: first come, first kept, all at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WAITING, KEPT, DROPPED = 0, 1, 2


def independent_set(count: int, pairs: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(count,) true for the items that a greedy pass in index order keeps.

    pairs: (P, 2) conflicts, in any order. The answer is that of the sequential loop "keep an item
    unless an earlier kept one conflicts with it", found in O(log count) vectorised rounds: an item
    is decided as soon as no earlier neighbour is waiting.
    """
    state = np.full(count, WAITING, np.uint8)
    first, second = pairs.min(axis=1), pairs.max(axis=1)
    while len(first):
        blocked = np.zeros(count, bool)
        blocked[second] = True
        state[(state == WAITING) & ~blocked] = KEPT
        state[second[state[first] == KEPT]] = DROPPED
        open_pairs = (state[first] == WAITING) & (state[second] == WAITING)
        first, second = first[open_pairs], second[open_pairs]
    kept: NDArray[np.bool_] = state != DROPPED
    return kept
