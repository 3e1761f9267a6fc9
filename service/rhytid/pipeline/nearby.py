"""Which wrinkles and pores a square of a map needs, so that a tile of a new frame does not wait
until those of the whole map have answered to the stretch.

They are counted in groups of VECTOR, which kernels of respond.cl and ends.cl take at once: elements
of a graph that follow one another lie side by side.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.launches import MOST_GROUP, whole_groups
from rhytid.device.runtime import Device
from rhytid.pipeline.cells import CellLists
from rhytid.pipeline.vectors import VECTOR, VectorTriangles
from rhytid.pipeline.work import BLOCK, Place, Square

Numbers = NDArray[np.int32]
# Of the number of an element, that say which of its group it is: a shift takes half of a division.
_BITS = VECTOR.bit_length() - 1


@dataclass(frozen=True)
class FrameValues(BufferGroup):
    """Values of elements or triangles in one frame, float32 on the device.

    filled: the places that have what they need; None: all.
    """

    values: Buffer
    filled: set[Place | None] = field(default_factory=set, init=False)

    @classmethod
    def allocate(cls, device: Device, count: int) -> FrameValues:
        """So many values, not initialised."""
        return cls(device.empty(count, np.float32))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.values,)


@dataclass(frozen=True)
class Wanted(BufferGroup):
    """What a kernel is launched for: so many numbers, int32 on the device; None: all, in order."""

    count: int
    numbers: Buffer | None = None

    @classmethod
    def upload(cls, device: Device, numbers: Numbers, at_once: int = 1) -> Self:
        """These numbers.  at_once: that a work-item takes."""
        last = np.repeat(numbers[-1:], -len(numbers) % (MOST_GROUP * at_once))
        return cls(len(numbers), device.upload(np.concatenate([numbers, last])))

    @property
    def items(self) -> int:
        """How many there are for a kernel that may be launched for the last number more than once:
        whole work-groups, in place of a launch for these and one for what is left."""
        return self.count if self.numbers is None else self.numbers.nbytes // 4

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.numbers,)


@dataclass(frozen=True)
class Groups(Wanted):
    """Numbers of groups of elements."""

    @classmethod
    def of(cls, elements: int) -> Groups:
        """All groups of so many elements, and some behind them."""
        return cls(whole_groups(-(-elements // VECTOR)))

    @classmethod
    def of_triangles(cls, device: Device, triangles: VectorTriangles) -> Groups:
        """The groups of the triangles under the texels of a tile."""
        return cls.upload(device, united([groups_of(triangles.numbers(device))]))


@dataclass(frozen=True)
class NearbyGroups(BufferGroup):
    """The groups that a square needs.

    wrinkles: of those that may be drawn there, and of the none behind the last.  answering: these
    where they have wrinkles, and those of wrinkles that continue them, from whose stretch theirs
    follows.  pores: of those that may be drawn there.
    """

    wrinkles: Groups
    answering: Groups
    pores: Groups

    @property
    def _buffers(self) -> tuple[Groups, ...]:
        return self.wrinkles, self.answering, self.pores


class NearbyElements:
    """The groups of each block of a UDIM."""

    def __init__(
        self,
        wrinkles: CellLists,
        pores: CellLists,
        count: int,
        partners: Numbers | None,
        cushion: tuple[CellLists, int] | None = None,
    ) -> None:
        """wrinkles, pores: lists by block.  count: K wrinkles.  partners (K, 2): as of
        WrinkleArrays.  cushion: lists of the broad layer, and texels per sample of it."""
        self._lists, self._pores = [(_grouped(wrinkles), BLOCK)], _grouped(pores)
        if cushion is not None:
            self._lists.append((_grouped(cushion[0]), BLOCK * cushion[1]))
        self._count, (self._offsets, self._partners) = count, _of_partners(partners)

    def of(self, device: Device, square: Square) -> NearbyGroups:
        """The groups of a square of level 0."""
        none = np.array([self._count // VECTOR], np.int32)
        found = (united([self._drawn(square), none]), self.answering(square), self.pores(square))
        return NearbyGroups(*(Groups.upload(device, some) for some in found))

    def answering(self, square: Square) -> Numbers:
        """Groups of wrinkles, as of NearbyGroups."""
        drawn = self._drawn(square)
        return united([drawn, self._beside(drawn)])

    def pores(self, square: Square) -> Numbers:
        """Groups of pores, as of NearbyGroups."""
        return united([in_square(self._pores, square, BLOCK)])

    def _drawn(self, square: Square) -> Numbers:
        drawn = [in_square(lists, square, side) for lists, side in self._lists]
        if self._count % VECTOR:  # the last wrinkles are in the group of none
            drawn.append(np.array([self._count // VECTOR], np.int32))
        return united(drawn)

    def _beside(self, groups: Numbers) -> Numbers:
        """The groups of wrinkles that continue those of some groups."""
        if not len(self._partners):
            return self._partners
        return listed(self._offsets, self._partners, groups)


def listed(offsets: Numbers, members: Numbers, numbers: Numbers) -> Numbers:
    """The members of some lists, one after the other.  offsets: of all lists into members."""
    first = offsets[numbers]
    counts = offsets[numbers + 1] - first
    at = np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    found: Numbers = members[at]
    return found


def groups_of(elements: Numbers) -> Numbers:
    """The number of the group of each element."""
    return elements >> _BITS


def elements_of(groups: Numbers, count: int) -> Numbers:
    """The elements of some groups, of so many in all."""
    each: Numbers = np.arange(VECTOR, dtype=np.int32)
    found: Numbers = np.add(VECTOR * groups[:, None], each, dtype=np.int32).reshape(-1)
    return found[found < count]


def _grouped(lists: CellLists) -> CellLists:
    """Lists of groups in place of their elements."""
    groups, offsets = lists.members >> _BITS, lists.offsets
    fresh = np.ones(len(groups) + 1, bool)
    np.not_equal(groups[1:], groups[:-1], out=fresh[1:-1])
    fresh[offsets] = True  # each cell begins anew
    before = np.concatenate([[0], np.cumsum(fresh[:-1])]).astype(np.int32)
    return CellLists(lists.cells, before[offsets], groups[fresh[:-1]])


def _of_partners(partners: Numbers | None) -> tuple[Numbers, Numbers]:
    """The groups of the partners of each group, but for itself: offsets, and numbers."""
    if partners is None:
        return np.zeros(1, np.int32), np.zeros(0, np.int32)
    other = partners >> _BITS  # -1 where there is none
    apart = other != (np.arange(len(partners), dtype=np.int32) >> _BITS)[:, None]
    apart &= other >= 0
    begins = np.arange(0, apart.size, 2 * VECTOR)
    counts = np.add.reduceat(apart.reshape(-1), begins, dtype=np.int32)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32), other[apart]


def in_square(lists: CellLists, square: Square, side: int) -> Numbers:
    """The members of the cells, of `side` texels a side, that a square lies in."""
    row, column, texels = square
    left, right = (
        np.clip(at, 0, lists.cells) for at in (column // side, -(-(column + texels) // side))
    )
    rows = range(max(row // side, 0), min(-(-(row + texels) // side), lists.cells))
    ends = ((lists.offsets[y * lists.cells + x] for x in (left, right)) for y in rows)
    return np.concatenate([np.zeros(0, np.int32), *(lists.members[a:b] for a, b in ends)])


def united(parts: list[Numbers]) -> Numbers:
    """Each number of some parts once, in order."""
    every = np.concatenate(parts)
    found = np.zeros(int(every.max(initial=-1)) + 1, bool)
    found[every] = True
    return np.flatnonzero(found).astype(np.int32)
