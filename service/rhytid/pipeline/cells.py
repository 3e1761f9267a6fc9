"""Lists of the boxes that overlap each cell of a square grid: of triangles to look up, or of
elements to draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.errors import LimitError

# An entry takes some forty bytes while the lists are made.
MOST_ENTRIES = 2**26


@dataclass(frozen=True)
class CellLists:
    """Lists by cell of the unit square.

    offsets (cells² + 1,): int32 into members, int32; the members of a cell ascend.
    work: (cells, cells), the work of drawing the members of each cell (work.py), or None.
    """

    cells: int
    offsets: NDArray[np.int32]
    members: NDArray[np.int32]
    work: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class Lists:
    """Block lists on the device."""

    offsets: Buffer
    members: Buffer

    @classmethod
    def upload(cls, device: Device, lists: CellLists) -> Lists:
        """The lists, on the device."""
        return cls(device.upload(lists.offsets), device.upload(lists.members))

    def release(self) -> None:
        """Give the memory back."""
        self.offsets.release()
        self.members.release()


def list_by_cell(
    low: NDArray[np.floating], high: NDArray[np.floating], cells: int, *, top_down: bool
) -> CellLists:
    """List the boxes that overlap each cell of the unit square.

    low, high: (K, 2) corners of the boxes, v up. Cells are numbered row by row, from the top
    where `top_down`, else from the bottom. A box outside the square is in no cell.
    Raises LimitError where there would be more than MOST_ENTRIES entries.
    """
    start, size = _covered(low, high, cells)
    width, height = np.ascontiguousarray(size.T)
    count = width * height
    total = int(count.sum(dtype=np.int64))
    if total > MOST_ENTRIES:
        raise LimitError(
            f"{total} entries in lists by cell, of {len(count)} boxes in {cells} x {cells} cells: "
            f"more than {MOST_ENTRIES}"
        )
    # 32 bits hold every number below, and numpy divides them in half the time.
    member = np.repeat(np.arange(len(count), dtype=np.int32), count)
    within = np.arange(total, dtype=np.int32) - (np.cumsum(count) - count).astype(np.int32)[member]
    row = within // width[member]
    column = within - row * width[member]
    first = (cells - 1 - start[:, 1] if top_down else start[:, 1]) * cells + start[:, 0]
    cell = first[member] + column + (-cells if top_down else cells) * row
    order = stable_order(cell, cells * cells)
    offsets = np.zeros(cells * cells + 1, np.int32)
    offsets[1:] = np.cumsum(np.bincount(cell, minlength=cells * cells))
    return CellLists(cells, offsets, member[order])


def stable_order(keys: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """The order that sorts keys from 0 to `count` - 1; equal ones stay in their order. Where 16
    bits hold them numpy counts in place of comparing."""
    narrow = keys.astype(np.uint16) if count <= 1 << 16 else keys
    return np.argsort(narrow, kind="stable")


def cells_that_fit(low: NDArray[np.floating], high: NDArray[np.floating], cells: int) -> int:
    """`cells`, halved until `list_by_cell` makes at most MOST_ENTRIES entries, or one is left."""
    while (
        cells > 1
        and _covered(low, high, cells)[1].prod(axis=1, dtype=np.int64).sum() > MOST_ENTRIES
    ):
        cells //= 2
    return cells


def _covered(
    low: NDArray[np.floating], high: NDArray[np.floating], cells: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The first cell (K, 2) of each box, and over how many cells (K, 2) it goes."""
    start = np.floor(np.clip(low * cells, 0, cells)).astype(np.int32)
    stop = np.floor(np.clip(high * cells + 1, 0, cells)).astype(np.int32)
    return start, np.maximum(stop - start, 0)
