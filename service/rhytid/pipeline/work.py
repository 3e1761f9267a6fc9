"""How much work it is to draw a square of a map, known from the lists of its blocks before it is
drawn, and how long the map of an uploaded graph may take.

The unit of work is one texel that one element covers. What an element costs beside its texels, and
a block beside its elements, was measured on PoCL with two cores and holds within a factor of 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rhytid.device.launches import FIRST_WORK, DrawingPace
from rhytid.device.runtime import Device
from rhytid.domain.wording import plural
from rhytid.errors import LimitError
from rhytid.pipeline.cells import CellLists

# Texels per side of the blocks that list what reaches into them.
BLOCK = 64
# Texels' worth of an element in the list of a block, and of a block without elements.
_ELEMENT, _BLANK = 32, 2048
# Entries of lists that are looked at together.
_CHUNK = 1 << 20
# (row, column, texels per side) of a square of a level.
Square = tuple[int, int, int]
# Seconds of the densest block, which is drawn at once.
_BLOCK_SECONDS = 0.1


class Place(NamedTuple):
    """A UDIM, and a square of its level 0.  blended: whether that is a tile of the fast method, for
    which few lines answer to stretch, and no pores."""

    udim: int
    square: Square
    blended: bool = False


class MapWork:
    """The work of drawing any square of a map whose sides are multiples of BLOCK."""

    def __init__(self, *of_lists: CellLists, cushion: tuple[CellLists, int] | None = None) -> None:
        """of_lists: lists of the elements of the map.  cushion: lists of the broad layer, and
        texels per sample of it; its blocks are drawn whole, however small the square is."""
        self._fine = _sums(sum((_work(lists) for lists in of_lists), np.float64(_BLANK)))
        self._coarse, self._factor = None, 1
        if cushion is not None:
            self._coarse, self._factor = _sums(_work(cushion[0]) + _BLANK), cushion[1]

    @property
    def total(self) -> float:
        """The work of the whole map."""
        coarse = 0.0 if self._coarse is None else float(self._coarse[-1, -1])
        return float(self._fine[-1, -1]) + coarse

    @property
    def densest(self) -> float:
        """The work of the densest block."""
        blocks = [self._fine] if self._coarse is None else [self._fine, self._coarse]
        return max(float(np.diff(np.diff(sums, axis=0), axis=1).max()) for sums in blocks)

    def of(self, row: int, column: int, side: int) -> float:
        """The work of `side`² texels of level 0 from (row, column) on; none of it outside the
        map."""
        found = _between(self._fine, (row, column), side, BLOCK)
        if self._coarse is not None:
            found += _between(self._coarse, (row, column), side, BLOCK * self._factor)
        return found

    def cut(self, square: Square, most: float, largest: int, least: int = BLOCK) -> list[Square]:
        """Cut a square into squares, halved until each has at most `largest` texels per side and at
        most the work `most`, or has `least` texels per side. Halves of an odd number of blocks
        overlap."""
        if self.is_piece(square, most, largest, least):
            return [square]
        row, column, side = square
        half = -(-side // (2 * BLOCK)) * BLOCK
        starts = (0, side - half)
        corners = ((row + y, column + x, half) for y in starts for x in starts)
        return [piece for corner in corners for piece in self.cut(corner, most, largest, least)]

    def is_piece(self, square: Square, most: float, largest: int, least: int = BLOCK) -> bool:
        """Whether `cut` leaves a square as it is."""
        side = square[2]
        return side < 2 * least or (side <= largest and self._divisible(square) <= most)

    def around(self, place: Square, most: float, largest: int, least: int = BLOCK) -> Square:
        """The square, of those that `cut` makes of the whole map, that a smaller square lies in."""
        row, column, side = place
        piece = _aligned(row, column, max(largest, side))
        while piece[2] // 2 >= max(least, side) and self._divisible(piece) > most:
            piece = _aligned(row, column, piece[2] // 2)
        return piece

    def _divisible(self, square: Square) -> float:
        """The work of a square that its quarters divide among them."""
        found = _between(self._fine, square[:2], square[2], BLOCK)
        if self._coarse is not None and square[2] > BLOCK * self._factor:
            found += _between(self._coarse, square[:2], square[2], BLOCK * self._factor)
        return found


def _aligned(row: int, column: int, side: int) -> Square:
    return row // side * side, column // side * side, side


def _work(lists: CellLists) -> NDArray[np.float64]:
    if lists.work is not None:
        return lists.work.astype(np.float64)
    counts = np.diff(lists.offsets).reshape(lists.cells, lists.cells)
    return counts * (2.0 * _ELEMENT)


def _sums(work: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n + 1, n + 1) sums of the work of all cells above and to the left."""
    return np.pad(np.cumsum(np.cumsum(work, axis=0), axis=1), ((1, 0), (1, 0)))


def _between(sums: NDArray[np.float64], corner: tuple[int, int], side: int, texels: int) -> float:
    """The work of the cells, of `texels` texels per side, that a square of `side` texels lies
    in."""
    end = len(sums) - 1
    top, left = (min(max(at // texels, 0), end) for at in corner)
    bottom, right = (min(max(-(-(at + side) // texels), 0), end) for at in corner)
    found = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return float(found)


def work_by_cell(
    lists: CellLists, low: NDArray[np.floating], high: NDArray[np.floating]
) -> NDArray[np.float32]:
    """(cells, cells) work of drawing the elements of each cell, the top row first.

    low, high: (K, 2) corners in UV of the boxes that `lists`, top down, were made from.
    """
    cells = lists.cells
    work = np.zeros(cells * cells)
    for first in range(0, len(lists.members), _CHUNK):
        last = min(first + _CHUNK, len(lists.members))
        begin = np.searchsorted(lists.offsets, first, "right") - 1
        end = np.searchsorted(lists.offsets, last, "left")
        bounds: NDArray[np.int64] = np.clip(lists.offsets[begin : end + 1], first, last)
        cell = np.repeat(np.arange(begin, end), bounds[1:] - bounds[:-1])
        members = lists.members[first:last]
        row, column = cells - 1 - cell // cells, cell % cells
        texels = _within(low, high, members, 0, column, cells)
        texels *= _within(low, high, members, 1, row, cells)
        texels += _ELEMENT
        work[begin:end] += np.bincount(cell - begin, texels, end - begin)
    return work.reshape(cells, cells).astype(np.float32)


def _within(
    low: NDArray[np.floating],
    high: NDArray[np.floating],
    members: NDArray[np.int32],
    axis: int,
    cell: NDArray[np.int64],
    cells: int,
) -> NDArray[np.float64]:
    """Texels along an axis that the boxes of members have in common with cells of BLOCK texels."""
    start = low[members, axis] * (cells * BLOCK) - cell * BLOCK
    stop = high[members, axis] * (cells * BLOCK) - cell * BLOCK
    found: NDArray[np.float64] = np.minimum(stop, BLOCK) - np.maximum(start, 0.0)
    return np.clip(found + 1.0, 1.0, BLOCK)


def work_around(
    low: NDArray[np.floating], high: NDArray[np.floating], resolution: int
) -> NDArray[np.float64]:
    """(blocks, blocks) an estimate of the work of boxes, corners (K, 2) in UV, in each block of a
    map, v down: a box is taken to cover all its blocks alike."""
    cells = max(resolution // BLOCK, 1)
    inside = (np.clip(corner.astype(np.float64), 0.0, 1.0) for corner in (low, high))
    low, high = inside
    first = np.minimum((low * cells).astype(np.int64), cells - 1)
    last = np.minimum((high * cells).astype(np.int64), cells - 1) + 1
    texels = np.prod((high - low) * resolution + 1.0, axis=1) / np.prod(last - first, axis=1)
    share = np.minimum(texels, BLOCK**2) + _ELEMENT
    steps = np.zeros((cells + 1, cells + 1))
    for y, x, sign in ((first, first, 1), (first, last, -1), (last, first, -1), (last, last, 1)):
        np.add.at(steps, (y[:, 1], x[:, 0]), sign * share)
    found: NDArray[np.float64] = np.cumsum(np.cumsum(steps, axis=0), axis=1)[:cells, :cells]
    return np.maximum(found, 0.0)


@dataclass(frozen=True)
class DrawLimit:
    """How long drawing the map of a UDIM may take.

    seconds: about so many.  per_second: work that the device does a second. The time is estimated
    from boxes around elements at any stretch: a frame takes a share of it.
    """

    seconds: float
    per_second: float = FIRST_WORK

    def check(
        self,
        low: NDArray[np.floating],
        high: NDArray[np.floating],
        resolution: int,
        what: str,
        udim: int,
    ) -> None:
        """Raise LimitError where drawing boxes (K, 2) in UV takes longer.  what: names them."""
        work = work_around(low, high, resolution)
        whole, block = work.sum() / self.per_second, work.max() / self.per_second
        drawing = f"drawing {plural(len(low), what, f'{what}s')} of UDIM {udim}"
        if whole > self.seconds:
            raise LimitError(
                f"{drawing} would take about {_seconds(whole)} s on this device at {resolution}² "
                f"texels: more than {_seconds(self.seconds)} s (RHYTID_DRAW_SECONDS)"
            )
        if block > _BLOCK_SECONDS:
            raise LimitError(
                f"{drawing} would take about {_seconds(block)} s on this device where they are "
                f"densest, in {BLOCK}² of {resolution}² texels: more than {_BLOCK_SECONDS} s"
            )


def timed(device: Device, pace: DrawingPace, work: float, draw: Callable[[], None]) -> None:
    """Draw and wait for it, as one step of the device; `pace` counts how long the work took."""

    def run() -> None:
        with pace.timing(work):
            draw()
            device.finish()

    device.step(run)


def _seconds(value: float) -> str:
    return f"{value:.3g}"
