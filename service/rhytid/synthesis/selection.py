"""Which of the worn edges become wrinkles. Kernel: independent.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.incidence import Incidence
from rhytid.synthesis.independent import chosen
from rhytid.synthesis.net import Net
from rhytid.synthesis.progress import Progress, part
from rhytid.synthesis.rounds import DROPPED, KEPT, NEEDED
from rhytid.synthesis.workspace import Workspace

# Every pore keeps so many of its edges before the strength alone decides: polygons close, and
# no wrinkle ends nowhere.
ENDS = 3


def preference(
    work: Workspace, net: Net, strength: NDArray[np.float32], progress: Progress
) -> NDArray[np.int32]:
    """(E,) indices of the edges of a net, of strength (E,), in the order in which they are wanted.

    First those that belong to the strongest of a pore and cross nothing stronger, then the others
    that cross nothing stronger, then the rest; by strength in each.
    """
    mark = _marks(work, net, strength, part(progress, 0.0, 0.6))
    wanted = []
    for index, state in enumerate((NEEDED, KEPT, DROPPED)):
        progress(0.6 + 0.1 * index, "selection")
        members = np.flatnonzero(mark == state).astype(np.int32)
        wanted.append(members[np.argsort(-strength[members], kind="stable")])
    return np.concatenate(wanted)


def _marks(
    work: Workspace, net: Net, strength: NDArray[np.float32], progress: Progress
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
