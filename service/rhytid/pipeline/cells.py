"""Lists of what overlaps each cell of a square grid: triangles to look up, elements to draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError

MOST_ENTRIES = 2**31 - 1


@dataclass(frozen=True)
class CellLists:
    """offsets (cells² + 1,) int32 into members, int32; the members of a cell ascend."""

    cells: int
    offsets: NDArray[np.int32]
    members: NDArray[np.int32]


def list_by_cell(
    low: NDArray[np.floating], high: NDArray[np.floating], cells: int, *, top_down: bool
) -> CellLists:
    """Which boxes overlap which cells of the unit square.

    low, high: (K, 2) corners of the boxes, v up. Cells are numbered row by row, from the top
    where `top_down`, else from the bottom. A box outside the square is in no cell.
    Raises LimitError where there would be more entries than an int32 can count.
    """
    start = np.floor(np.clip(low * cells, 0, cells)).astype(np.int64)
    stop = np.floor(np.clip(high * cells + 1, 0, cells)).astype(np.int64)
    width, height = np.maximum(stop - start, 0).T
    count = width * height
    total = int(count.sum())
    if total > MOST_ENTRIES:
        raise LimitError(f"{total} entries of cells and elements: more than {MOST_ENTRIES}")
    member = np.repeat(np.arange(len(count), dtype=np.int32), count)
    within = np.arange(total) - np.repeat(np.cumsum(count) - count, count)
    column = start[member, 0] + within % width[member]
    row = start[member, 1] + within // width[member]
    cell = (cells - 1 - row if top_down else row) * cells + column
    order = np.argsort(cell, kind="stable")
    offsets = np.zeros(cells * cells + 1, np.int32)
    offsets[1:] = np.cumsum(np.bincount(cell, minlength=cells * cells))
    return CellLists(cells, offsets, member[order])
