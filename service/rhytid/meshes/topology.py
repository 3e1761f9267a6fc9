"""How the triangles of a mesh hang together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh, has_area

Mask = NDArray[np.bool_]
IntArray = NDArray[np.int64]
# Vertices are at one place in a cell of this share of the mesh's longest side.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Topology:
    """Triangles (F,) of a mesh as one surface: vertices at the same place count as one, such as a
    writer has split along UV seams.

    component: (F,) number of the part that a triangle belongs to, the largest area first.
    loop: (F,) number of the open border that it lies on, the longest first; -1 for none.
    loop_edges, loop_lengths: (B,) edges of each border, and its length in mesh units.
    non_manifold, inconsistent: how many edges have more than two triangles; how many have two that
    are wound against one another.
    at_non_manifold: (F,) at such an edge.  flipped: (F,) wound against most of their part.
    twisted: parts that no turning over of triangles makes consistent.
    degenerate: (F,) without area in space.  split, unused: vertices at the place of another one,
    and of no triangle.
    """

    component: IntArray
    loop: IntArray
    loop_edges: IntArray
    loop_lengths: NDArray[np.float64]
    non_manifold: int
    inconsistent: int
    at_non_manifold: Mask
    flipped: Mask
    twisted: int
    degenerate: Mask
    split: int
    unused: int

    @property
    def components(self) -> int:
        """How many parts there are that share no vertex."""
        return int(self.component.max()) + 1

    @property
    def loops(self) -> int:
        """How many open borders there are; borders that touch count as one."""
        return len(self.loop_edges)

    @classmethod
    def of(cls, mesh: Mesh) -> Topology:
        """The topology of a mesh."""
        edges = _Edges(mesh)
        component = _by_size(joined(edges.ends, len(edges.points))[edges.faces[:, 0]], edges.area)
        loop, lengths = edges.loops()
        flipped, twisted = edges.winding()
        return cls(
            component, loop, np.bincount(loop[edges.open_triangle], minlength=len(lengths)),
            lengths, int((edges.count > 2).sum()), int(edges.against.sum()),
            edges.touching(edges.count > 2), flipped, twisted,
            ~has_area(edges.points[edges.faces]), edges.split, edges.unused,
        )  # fmt: skip


class _Edges:
    """The edges of a mesh whose vertices are welded where they are at one place."""

    def __init__(self, mesh: Mesh) -> None:
        positions = mesh.positions.astype(np.float64)
        cells = np.round(positions / (_SAME * np.ptp(positions, axis=0).max())).astype(np.int64)
        welded = numbered(cells)
        self.points = np.empty((int(welded.max()) + 1, 3))
        self.points[welded[::-1]] = positions[::-1]  # the first of those at one place
        self.faces: IntArray = welded[mesh.faces]
        used = len(distinct(mesh.faces))
        self.unused = len(mesh.positions) - used
        self.split = used - len(distinct(self.faces))
        corner = self.points[self.faces]
        self.area = np.linalg.norm(np.cross(*np.diff(corner, axis=1).swapaxes(0, 1)), axis=1) / 2
        directed = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        real = directed[:, 0] != directed[:, 1]
        key = directed.min(axis=1) * len(self.points) + directed.max(axis=1)
        unique, of = np.unique(key, return_inverse=True)
        self.ends: IntArray = np.stack(np.divmod(unique, len(self.points)), axis=1)
        self.triangle, self.of = np.flatnonzero(real) // 3, of.reshape(-1)[real]
        self.count = np.bincount(self.of, minlength=len(self.ends))
        sign = np.where(directed[real, 0] < directed[real, 1], 1, -1)
        self.against = (self.count == 2) & (np.bincount(self.of, sign, len(self.ends)) != 0)
        open_ = np.flatnonzero(self.count[self.of] == 1)
        self.open_triangle, self.open_edge = self.triangle[open_], self.of[open_]

    def touching(self, chosen: Mask) -> Mask:
        """(F,) triangles at chosen edges."""
        mask = np.zeros(len(self.faces), bool)
        mask[self.triangle[chosen[self.of]]] = True
        return mask

    def loops(self) -> tuple[IntArray, NDArray[np.float64]]:
        """(F,) the border of each triangle, -1 for none; (B,) the lengths of borders."""
        loop = np.full(len(self.faces), -1, np.int64)
        ends = self.ends[self.open_edge]
        if not len(ends):
            return loop, np.zeros(0)
        length = np.linalg.norm(np.diff(self.points[ends], axis=1)[:, 0], axis=1)
        number = _by_size(joined(ends, len(self.points))[ends[:, 0]], length)
        loop[self.open_triangle] = number
        return loop, np.bincount(number, length).astype(np.float64)

    def winding(self) -> tuple[Mask, int]:
        """(F,) triangles against most of their part, by area; how many parts are twisted.

        Each triangle has two nodes, one per side; neighbours join sides, crosswise where they are
        wound against one another. A part with both sides in one is twisted.
        """
        twice = np.flatnonzero(self.count[self.of] == 2)
        pair = twice[np.argsort(self.of[twice], kind="stable")].reshape(-1, 2)
        one, two = self.triangle[pair].T
        cross, count = self.against[self.of[pair[:, 0]]].astype(np.int64), len(self.faces)
        sides = [np.stack([one + s * count, two + (s ^ cross) * count], axis=1) for s in (0, 1)]
        label = joined(np.concatenate(sides), 2 * count)
        front, back = label.reshape(2, count)
        both = front == back
        size = np.bincount(label, np.tile(self.area, 2) * np.repeat([1, 0], count))
        # Equal halves: the side of the first triangle counts as right.
        first = np.zeros(len(size), np.int64)
        first[front[::-1]] = np.arange(count)[::-1]
        other = np.where(size[front] == size[back], first[front] > first[back], False)
        flipped = ~both & ((size[front] < size[back]) | other)
        return flipped, len(distinct(front[both]))


def distinct(numbers: NDArray[np.signedinteger[Any]]) -> IntArray:
    """The different ones of numbers from 0 on, in order: np.unique would import numpy.ma, which
    takes a fifth of the time of a check."""
    return np.flatnonzero(np.bincount(numbers.ravel()))


def joined(ends: IntArray, nodes: int) -> IntArray:
    """(nodes,) numbers of parts, in the order of their first nodes; nodes that the edges (E, 2)
    join share one.

    Every part points to the least of those that it has an edge with, until none has another. In
    numpy: importing SciPy's graphs takes longer than this does for a face.
    """
    least: IntArray = np.arange(nodes)
    while True:
        one, two = least[ends].T
        apart = one != two
        if not apart.any():
            break
        np.minimum.at(least, np.maximum(one, two)[apart], np.minimum(one, two)[apart])
        while not np.array_equal(jump := least[least], least):
            least = jump
    return _places(least == np.arange(nodes))[least]


def numbered(points: NDArray[np.number[Any]]) -> IntArray:
    """(N,) a number for each of points (N, D), the same for equal ones, in the order of their
    coordinates: np.unique takes twice as long."""
    order = np.lexsort(points.T[::-1])
    new = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    number = np.zeros(len(points), np.int64)
    number[order[1:]] = np.cumsum(new)
    return number


def _places(mask: Mask) -> IntArray:
    """For each that is true, how many are true before it."""
    places: IntArray = np.cumsum(mask) - 1
    return places


def _by_size(label: IntArray, size: NDArray[np.float64]) -> IntArray:
    """(K,) labels as numbers from 0 on, that of the greatest sum of sizes (K,) first."""
    number = _places(np.bincount(label) > 0)[label]
    order = np.argsort(-np.bincount(number, size), kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    ranked: IntArray = rank[number]
    return ranked
