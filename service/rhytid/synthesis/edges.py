"""Candidate wrinkles: straight lines in the map from each pore to its nearest on the surface, and
which of them cross. Kernels: nearest.cl, edges.cl, trace.cl, crossings.cl."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.fields import Fields, looked_up
from rhytid.synthesis.incidence import Incidence, starts_of
from rhytid.synthesis.lattice import DevicePoints, Lattice
from rhytid.synthesis.pore_density import spacings
from rhytid.synthesis.pores import map_corners
from rhytid.synthesis.progress import Progress, masked, part, silent
from rhytid.synthesis.seams.charts import BORDER, LONGEST, meets_at_seam
from rhytid.synthesis.surface import BoolArray, IntArray, Points, Surface
from rhytid.synthesis.workspace import Workspace

# Longest wrinkle, in disc radii: between maximal discs no polygon needs a longer side.
REACH = 2.2
# Of two wrinkles that leave a pore at a smaller angle the longer is no candidate: it would run
# beside the shorter as a double line.
LEAST_ANGLE = float(np.radians(35.0))
# Ways out of a pore; ten such angles fill a circle.
WAYS = 12
DEFINES = {"WAYS": WAYS}
# Surface length of a straight line in the map over the distance of its pores.
DETOUR = 1.4
_ROWS = 1 << 18
# Pores whose neighbours a work-item looks for, as in nearest.cl.
_TOGETHER = 8
# Edges that are looked at together, and partners of one that there is room for at first; of edges
# with more fewer are looked at together.
_BLOCK, _PARTNERS = 1 << 19, 8
# Of a step of the lattice: products of four coordinates stay within float32. A power of two rounds
# nothing, so that crossings do not depend on the lengths of other edges.
_SCALE = 2.0**-15


@dataclass(frozen=True, eq=False)
class Edges:
    """Candidate wrinkles, in the order of their first pore, then of their second.

    nodes (E, 2) int32: the pores joined, the lower number first.  length (E,) float32: their
    distance.  middle (E,) int32: the triangle of the midpoint, BORDER for a wrinkle across a seam.
    """

    nodes: NDArray[np.int32]
    length: NDArray[np.float32]
    middle: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.nodes)

    def take(self, index: BoolArray | IntArray) -> Edges:
        """The edges of an index or a mask, in its order."""
        return Edges(self.nodes[index], self.length[index], self.middle[index])


def candidates(
    work: Workspace,
    surface: Surface,
    across: NDArray[np.int32],
    pores: Points,
    radius: float,
    count: int,
    progress: Progress,
    fields: Fields | None = None,
) -> tuple[Edges, NDArray[np.float32]]:
    """The edges from each pore to its `count` nearest that can be drawn on the map, and (N,) the
    distance from each pore to the nearest, infinity where none is within reach of an edge.

    across: (F, 3) neighbours of the triangles.  radius: of the discs around the pores, in units of
    the surface.
    """
    fields = fields or Fields()
    with work.nested() as nested:
        factor = looked_up(partial(spacings, fields), pores)
        lattice = Lattice.absolute(radius, *surface.extent)
        cell = REACH * radius * float(factor.max(initial=0.0))
        cloud = DevicePoints.of(nested, pores, cell, lattice)
        found = nested.lend(factor)
        ways, nearest = _ways(nested, cloud, found, radius, count, part(progress, 0.0, 0.6))
        nodes, length = _pairs(nested, cloud, ways)
        nested.release(ways, found, *cloud.points, cloud.grid.head, cloud.grid.next)
        tracing = part(progress, 0.7, 0.95)
        middle = _middles(nested, surface, across, pores, nodes, length, tracing)
    progress(0.95, "edges")
    drawable = middle != BORDER
    rest = np.flatnonzero(~drawable)
    for start in range(0, len(rest), _ROWS):
        rows = rest[start : start + _ROWS]
        drawable[rows] = meets_at_seam(surface, across, pores, nodes[rows], length[rows])
        progress(0.95 + 0.05 * start / len(rest), "edges")
    return Edges(*masked(drawable, nodes, length, middle)), nearest


def _ways(
    work: Workspace,
    cloud: DevicePoints,
    factor: Buffer,
    radius: float,
    count: int,
    progress: Progress,
) -> tuple[Buffer, NDArray[np.float32]]:
    """(N, WAYS) int32 on the device: the neighbours of each pore that no nearer one hides; and (N,)
    the distance to the nearest."""
    shared = (
        *cloud.points, factor, *cloud.grid.arguments, float(cloud.lattice.unit / radius),
        float(REACH),
    )  # fmt: skip
    nearest2 = work.readable(cloud.count, np.float32)
    far2 = work.empty(cloud.count, np.float32)
    far, ways = work.empty(cloud.count, np.int32), work.empty(WAYS * cloud.count, np.int32)
    work.run(
        "nearest", "list_near", -(-cloud.count // _TOGETHER), cloud.count, count, *shared, nearest2,
        far2, far, ways, defines=DEFINES, report=lambda share: progress(0.5 * share, "edges"),
    )  # fmt: skip
    work.run(
        "nearest", "find_neighbours", cloud.count, *shared,
        float(np.cos(LEAST_ANGLE) ** 2), far2, far, ways,
        defines=DEFINES, report=lambda share: progress(0.5 + 0.5 * share, "edges"),
    )  # fmt: skip
    nearest = np.float32(radius) * np.sqrt(work.read(nearest2, (cloud.count,), np.float32))
    work.release(nearest2, far2, far)
    return ways, nearest


def _pairs(
    work: Workspace, cloud: DevicePoints, ways: Buffer
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """(E, 2) pairs of pores that are neighbours of each other, and (E,) their distance."""
    counts = work.readable(cloud.count, np.int32)
    work.run("edges", "count_edges", cloud.count, ways, counts, defines=DEFINES)
    starts = starts_of(work.read(counts, (cloud.count,), np.int32))
    edges, offsets = int(starts[-1]), work.lend(starts)
    nodes, length = work.readable(2 * edges, np.int32), work.readable(edges, np.float32)
    work.run(
        "edges", "list_edges", cloud.count, ways, offsets, cloud.place,
        float(cloud.lattice.unit), nodes, length, defines=DEFINES,
    )  # fmt: skip
    found = work.read(nodes, (edges, 2), np.int32), work.read(length, (edges,), np.float32)
    work.release(counts, offsets, nodes, length)
    return found


def _middles(
    work: Workspace,
    surface: Surface,
    across: NDArray[np.int32],
    pores: Points,
    nodes: NDArray[np.int32],
    length: NDArray[np.float32],
    progress: Progress,
) -> NDArray[np.int32]:
    """(E,) the middle triangle of each straight line in the map, BORDER where there is none."""
    jacobian = surface.jacobian.transpose(0, 2, 1)
    corners = work.upload(map_corners(surface.uv))  # read eight numbers at a time
    lent = (
        nodes, length, pores.uv.astype(np.float32, copy=False),
        pores.triangle.astype(np.int32, copy=False),
    )  # fmt: skip
    of_mesh = (
        across.astype(np.int32), jacobian.astype(np.float32), surface.carries.astype(np.uint8)
    )  # fmt: skip
    middle = work.readable(len(nodes), np.int32)
    work.run(
        "trace", "trace_edges", len(nodes), *(work.lend(a) for a in lent), corners,
        *(work.lend(a) for a in of_mesh), LONGEST, DETOUR, middle,
        report=lambda share: progress(share, "edges"),
    )  # fmt: skip
    found: NDArray[np.int32] = work.read(middle, (len(nodes),), np.int32)
    return found


def crossings(
    work: Workspace,
    pores: Points,
    nodes: NDArray[np.int32],
    length: NDArray[np.float32],
    progress: Progress = silent,
    lattice: Lattice | None = None,
) -> NDArray[np.int32]:
    """(P, 2) pairs of edges that cross, seen along the normal between them, each pair once.

    nodes (E, 2): the pores of each edge.  length (E,): the distance of these.  Edges with a common
    pore do not cross, nor do edges on different sheets.  lattice: of the places of pores; without
    it, one around them.
    """
    if not len(nodes):
        return np.empty((0, 2), np.int32)
    if not (nodes[1:, 0] >= nodes[:-1, 0]).all():  # neighbours at work see the same memory
        order = np.argsort(nodes[:, 0], kind="stable").astype(np.int32)
        return order[crossings(work, pores, nodes[order], length[order], progress, lattice)]
    with work.nested() as nested:
        return np.concatenate(list(_blocks(nested, pores, nodes, length, progress, lattice)))


def _blocks(
    work: Workspace,
    pores: Points,
    nodes: NDArray[np.int32],
    length: NDArray[np.float32],
    progress: Progress,
    lattice: Lattice | None,
) -> Iterator[NDArray[np.int32]]:
    """The pairs, found for a block of edges at a time."""
    typical = max(2.5 * float(length.mean()), 1e-9)
    cloud = DevicePoints.of(work, pores, typical, lattice)
    members = work.lend(nodes)
    lists = Incidence.of(work, members, len(nodes), len(pores))
    shared = (
        members, work.lend(length), lists.offsets, lists.pairs, lists.others, *cloud.points,
        float(cloud.lattice.unit), _SCALE, *cloud.grid.arguments,
    )  # fmt: skip
    for start in range(0, len(nodes), _BLOCK):
        progress(start / len(nodes), "crossings")
        yield from _found(work, shared, start, min(_BLOCK, len(nodes) - start), _PARTNERS)


def _found(
    work: Workspace, shared: tuple[Any, ...], start: int, count: int, room: int
) -> Iterator[NDArray[np.int32]]:
    """(P, 2) the crossings of edges `start` to `start + count`. There is room for `room` of each
    edge; where one has more, the kernel runs again with more room over fewer edges at a time."""
    partners, partners_of = _launched(work, shared, start, count, room)
    most = int(partners_of.max())
    if most <= room:
        some = np.flatnonzero(partners_of).astype(np.int32)  # few cross anything
        edge = np.repeat(start + some, partners_of[some])
        of = partners[some][np.arange(room) < partners_of[some, None]]
        yield np.stack([edge, of], axis=-1)
        return
    step = max(_BLOCK * _PARTNERS // most, 1)
    for first in range(start, start + count, step):
        yield from _found(work, shared, first, min(step, start + count - first), most)


def _launched(
    work: Workspace, shared: tuple[Any, ...], start: int, count: int, room: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(count, room) the partners of each edge, and (count,) how many it has, which may be more."""
    found, much = work.readable(count * room, np.int32), work.readable(count, np.int32)
    work.run(
        "crossings", "find_crossings", count, start, *shared, found, much,
        defines={"CROSSINGS": room},
    )  # fmt: skip
    partners = work.read(found, (count, room), np.int32)
    partners_of = work.read(much, (count,), np.int32)
    work.release(found, much)
    return partners, partners_of
