"""Which wrinkles cross which. Kernel: crossings.cl."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.edges.incidence import Incidence
from rhytid.synthesis.pores.device_points import DevicePoints
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace

# Edges that are looked at together, and partners of one that there is room for at first; of edges
# with more fewer are looked at together.
_BLOCK, _PARTNERS = 1 << 19, 8
# Of a step of the lattice: products of four coordinates stay within float32. A power of two rounds
# nothing, so that what crosses does not hang on the lengths of other edges.
_SCALE = 2.0**-15


def crossings(
    work: Workspace,
    pores: Points,
    nodes: NDArray[np.int32],
    length: NDArray[np.float32],
    progress: Progress = silent,
    lattice: Lattice | None = None,
) -> NDArray[np.int32]:
    """(P, 2) pairs of edges that cross, seen along the normal between them, each once.

    nodes: (E, 2).  length: (E,), the distance of the two.  Edges with a common pore do not cross,
    nor do those of different sheets.  lattice: of the places of pores; one around them if none is
    given.
    """
    if not len(nodes):
        return np.empty((0, 2), np.int32)
    if not (nodes[1:, 0] >= nodes[:-1, 0]).all():  # neighbours at work see the same memory
        order = np.argsort(nodes[:, 0], kind="stable").astype(np.int32)
        return order[crossings(work, pores, nodes[order], length[order], progress, lattice)]
    with work.room() as room:
        return np.concatenate(list(_blocks(room, pores, nodes, length, progress, lattice)))


def _blocks(
    work: Workspace,
    pores: Points,
    nodes: NDArray[np.int32],
    length: NDArray[np.float32],
    progress: Progress,
    lattice: Lattice | None,
) -> Iterator[NDArray[np.int32]]:
    """Pairs, from some edges after others."""
    typical = max(1.5 * float(length.mean()), 1e-9)
    cloud = DevicePoints.of(work, pores, typical, lattice)
    members = work.upload(nodes)
    lists = Incidence.of(work, members, len(nodes), len(pores))
    shared = (
        members, work.upload(length), lists.offsets, lists.pairs, lists.others, *cloud.points,
        float(cloud.lattice.unit), _SCALE, *cloud.grid.arguments,
    )  # fmt: skip
    for start in range(0, len(nodes), _BLOCK):
        progress(start / len(nodes), "crossings")
        yield from _found(work, shared, start, min(_BLOCK, len(nodes) - start), _PARTNERS)


def _found(
    work: Workspace, shared: tuple[Any, ...], start: int, count: int, room: int
) -> Iterator[NDArray[np.int32]]:
    """(P, 2) the crossings that edges start to start + count find, with room for so many each;
    where one has more, some edges after others."""
    partners, partners_of = _launched(work, shared, start, count, room)
    most = int(partners_of.max())
    if most <= room:
        edge, slot = np.nonzero(np.arange(room) < partners_of[:, None])
        yield np.stack([edge.astype(np.int32) + np.int32(start), partners[edge, slot]], axis=-1)
        return
    step = max(_BLOCK * _PARTNERS // most, 1)
    for first in range(start, start + count, step):
        yield from _found(work, shared, first, min(step, start + count - first), most)


def _launched(
    work: Workspace, shared: tuple[Any, ...], start: int, count: int, room: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(count, room) partners of edges, and (count,) how many there are, at least."""
    found, much = work.empty(count * room, np.int32), work.empty(count, np.int32)
    work.run(
        "crossings", "find_crossings", count, start, *shared, found, much,
        defines={"CROSSINGS": room},
    )  # fmt: skip
    partners = work.read(found, (count, room), np.int32)
    partners_of = work.read(much, (count,), np.int32)
    work.release(found, much)
    return partners, partners_of
