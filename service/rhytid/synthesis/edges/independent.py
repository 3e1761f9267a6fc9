"""Greedy independent sets: first come, first kept, all at once. Kernel: independent.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.synthesis.edges.incidence import Incidence
from rhytid.synthesis.edges.rounds import KEPT, until_decided
from rhytid.synthesis.workspace import Workspace


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
