"""Places in space as whole numbers, so that the device takes exact differences of them, and points
at such places on the device, listed by the cells of a grid. Kernels: grid.cl, points.clh."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace

_STEPS = 30
# A length that places are counted for has 2^_FINE steps: the order of places is the same at any
# scale of the mesh.
_FINE = 16
# Places that a thread asks a tree for at a time: some hundredths of a second.
_ASKED = 1 << 14
# Cells along a side of the grid around a few places, at most.
_SIDE = 256
# What the origin is moved by where a mesh is far from that of its coordinates, in steps.
_BLOCK = 2.0 ** (_STEPS - 4)


@dataclass(frozen=True, eq=False)
class Lattice:
    """A cube of 2³⁰ steps per side.

    origin (3,): its lowest corner.  unit: a step.
    """

    origin: NDArray[np.float64]
    unit: float

    @classmethod
    def around(cls, *points: NDArray[np.floating]) -> Lattice:
        """The finest lattice that holds all points of arrays (N, 3)."""
        ends = [end for p in points for end in bounds(p)]
        low, high = np.min(ends, axis=0).astype(np.float64), np.max(ends, axis=0)
        extent = max(float((high - low).max()), 1e-30)
        return cls(low, 2.0 ** (int(np.floor(np.log2(extent))) + 1 - _STEPS))

    @classmethod
    def absolute(
        cls, length: float, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> Lattice:
        """A lattice for `length` that holds everything from `low` (3,) to `high` (3,).

        Its middle is the origin of coordinates, from which it reaches 2¹³ lengths, so that it does
        not depend on the points. It is moved where they reach further, and its steps are coarser
        where they do not fit.
        """
        unit = length * 2.0**-_FINE
        half = 2.0 ** (_STEPS - 1) - 1.0
        if max(np.abs(low).max(), np.abs(high).max()) < half * unit:
            return cls(np.full(3, -(2.0 ** (_STEPS - 1)) * unit), unit)
        while float((high - low).max()) >= (2.0**_STEPS - 2.0 * _BLOCK) * unit:
            unit *= 2.0
        return cls(np.floor(low / (_BLOCK * unit)) * _BLOCK * unit, unit)

    def places(self, positions: NDArray[np.floating]) -> NDArray[np.int32]:
        """(..., 3) positions as whole steps from the origin."""
        places = np.empty(positions.shape, np.int32)

        def find(rows: slice) -> None:
            places[rows] = np.rint((positions[rows] - self.origin) / self.unit)

        over_rows(len(places), find)
        return places

    def positions(self, places: NDArray[np.int32]) -> NDArray[np.float64]:
        """(..., 3) the positions of places."""
        positions = np.empty(places.shape)

        def find(rows: slice) -> None:
            positions[rows] = self.origin + self.unit * places[rows]

        over_rows(len(places), find)
        return positions

    def steps(self, length: float) -> int:
        """A length in steps, at least one; rounded up."""
        return int(np.clip(np.ceil(length / self.unit), 1, 2**_STEPS))


def bounds(points: NDArray[np.floating]) -> tuple[NDArray[Any], NDArray[Any]]:
    """(3,) the least and (3,) the most coordinates of points (N, 3)."""
    ends: list[NDArray[np.floating]] = []

    def find(rows: slice) -> None:
        ends.extend((points[rows].min(axis=0), points[rows].max(axis=0)))

    over_rows(len(points), find)
    return np.min(ends, axis=0), np.max(ends, axis=0)


def spatial_order(places: NDArray[np.int32]) -> NDArray[np.intp]:
    """(N,) the order of places (N, 3) along Morton's curve, in which neighbours are near each
    other.

    Which of two places comes first depends on these two alone.
    """
    code = np.zeros(len(places), np.uint64)

    def find(rows: slice) -> None:
        for axis in range(3):
            coarse = places[rows, axis].astype(np.uint64) >> np.uint64(_STEPS - 21)
            code[rows] |= _spread(coarse) << np.uint64(axis)

    over_rows(len(code), find)
    order: NDArray[Any] = np.argsort(code)
    ordered = code[order]
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(same):  # few: to sort all by their places would take longer than all else here
        at = np.union1d(same, same + 1)
        tied = np.sort(order[at])
        order[at] = tied[np.lexsort((*places[tied].T, code[tied]))]
    return order


def mask_of_lists(points: int) -> np.uint32:
    """The mask of the numbers of lists for about so many points."""
    mask: np.uint32 = np.uint32((2 << max(points, 64).bit_length()) - 1)
    return mask


@dataclass(frozen=True, eq=False)
class Grid:
    """Lists, by cell, of the numbers of points.

    cell: side of a cell in steps of the lattice.  mask: of the numbers of lists.
    """

    cell: int
    mask: np.uint32
    head: Buffer
    next: Buffer

    @classmethod
    def empty(cls, work: Workspace, cell: int, points: int, numbers: int | None = None) -> Grid:
        """Empty lists for about so many points, whose numbers are below `numbers`."""
        mask = mask_of_lists(points)
        head = work.full(int(mask) + 1, np.int32(-1))
        return cls(cell, mask, head, work.empty(numbers or points, np.int32))

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of kernels that read the lists."""
        return self.cell, self.mask, self.head, self.next

    def insert(self, work: Workspace, place: Buffer, start: int, count: int) -> None:
        """Insert points `start` to `start + count` at their places."""
        work.run("grid", "insert_range", count, start, place, *self.arguments)

    def insert_listed(self, work: Workspace, place: Buffer, listed: Buffer, count: int) -> None:
        """Insert the first `count` points of a list of numbers."""
        work.run("grid", "insert_points", count, listed, place, *self.arguments)


@dataclass(frozen=True, eq=False)
class DevicePoints:
    """N points: place (N, 3) int32 steps of the lattice, normal (N, 3) float32, in a grid."""

    count: int
    lattice: Lattice
    place: Buffer
    normal: Buffer
    grid: Grid

    @classmethod
    def of(
        cls, work: Workspace, points: Points, cell: float, lattice: Lattice | None = None
    ) -> DevicePoints:
        """Upload points, in cells of side `cell`; on a lattice around them if none is given."""
        lattice = lattice or Lattice.around(points.position)
        place = work.lend(lattice.places(points.position))
        normal = work.lend(points.normal.astype(np.float32, copy=False))
        grid = Grid.empty(work, lattice.steps(cell), len(points))
        grid.insert(work, place, 0, len(points))
        return cls(len(points), lattice, place, normal, grid)

    @property
    def points(self) -> tuple[Any, ...]:
        """Places and normals, as arguments of kernels."""
        return self.place, self.normal


class Around:
    """Tells places that may lie within `reach` of some centres (E, 3) from those that do not, by
    the cells of a grid: few are near, and of each a tree takes long to say that it is not."""

    def __init__(self, centres: NDArray[np.float64], reach: float) -> None:
        low, high = centres.min(axis=0), centres.max(axis=0)
        self._cell = max(reach * (1.0 + 1e-6), float((high - low).max()) / _SIDE)
        # To either side of the cells with centres one that is near, and one that all beyond is in.
        self._low = low - 2.0 * self._cell
        at = ((centres - self._low) / self._cell).astype(np.int64)
        self._near = np.zeros(at.max(axis=0) + 3, np.bool_)
        for step in product((-1, 0, 1), repeat=3):
            self._near[tuple((at + step).T)] = True

    def near(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """The numbers of places (N, 3) that may be near, ascending."""
        number = np.zeros(len(places), np.int64)
        for axis, side in enumerate(self._near.shape):
            at = (places[:, axis] - self._low[axis]) / self._cell
            number *= side
            number += np.clip(at, 0.0, side - 1.0).astype(np.int64)
        found: NDArray[np.int64] = np.flatnonzero(self._near.ravel().take(number))
        return found

    def all_near(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """`near` of many places, on as many threads as there are cores."""
        found: dict[int, NDArray[np.int64]] = {}

        def find(rows: slice) -> None:
            found[rows.start] = rows.start + self.near(places[rows])

        over_rows(len(places), find)
        return np.concatenate([np.empty(0, np.int64), *(found[first] for first in sorted(found))])


def nearest_within(
    tree: scipy.spatial.cKDTree, places: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """The numbers of those of places (N, 3) that are within `reach` of a point of a tree,
    ascending, how far each is from the nearest, and which that is; on as many threads as there are
    cores, and only of places that may be near."""
    some = Around(tree.data, reach).all_near(places)
    distance, nearest = np.empty(len(some)), np.empty(len(some), np.int64)

    def find(rows: slice) -> None:
        asked = tree.query(places[some[rows]], distance_upper_bound=reach)
        distance[rows], nearest[rows] = asked

    over_rows(len(some), find, _ASKED)
    near = np.isfinite(distance)
    return some[near], distance[near], nearest[near]


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The lowest 21 bits, three apart."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        value = (value | (value << np.uint64(shift))) & np.uint64(mask)
    return value
