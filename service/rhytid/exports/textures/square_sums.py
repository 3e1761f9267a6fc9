"""Sums of a map over the square around each texel, by running sums in double."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.support.cores import on_all_cores

# Rows whose columns are summed anew, and of these how many are worked on at a time: those of a map
# of 4096 texels stay in the cache of a core.
_PART, _STEP = 256, 16

# Sums (n, R) of some rows: the first row, and they.
Sums = tuple[int, NDArray[np.float64]]


def with_square_sums(
    values: Callable[[slice], NDArray[Any]],
    side: int,
    size: int,
    work: Callable[[Sums], None],
) -> None:
    """Call `work` with the sums over the squares of `size` texels, an odd number, around the texels
    of a map (side, side); beyond the map there is nothing. A few rows at a time, on all cores.

    values: those of some rows. Relative error 1e-13 of the largest sum of some rows.
    """

    def part(start: int) -> None:
        for found in _sums(values, side, size, start, min(start + _PART, side)):
            work(found)

    on_all_cores(part, range(0, side, _PART))


def _sums(
    values: Callable[[slice], NDArray[Any]], side: int, size: int, start: int, end: int
) -> Iterator[Sums]:
    """Of rows from `start` to `end`."""
    half = size // 2
    # Of each column, the sum over the rows of the square around the row before.
    columns = values(_rows(start - half - 1, start + half, side)).sum(axis=0, dtype=np.float64)
    wide = np.zeros((_STEP, side + size))
    for first in range(start, end, _STEP):
        stop = min(first + _STEP, end)
        change = np.zeros((stop - first, side))
        come, gone = _rows(first + half, stop + half, side), _rows(0, stop - half - 1, side)
        gone = slice(max(first - half - 1, 0), gone.stop)
        change[: come.stop - come.start] += values(come)
        change[len(change) - (gone.stop - gone.start) :] -= values(gone)
        for row in change:
            row += columns
            columns = row
        across = wide[: len(change)]
        np.cumsum(change, axis=1, out=across[:, half + 1 : half + 1 + side])
        across[:, half + 1 + side :] = across[:, half + side, None]
        yield first, across[:, size:] - across[:, :side]


def _rows(start: int, stop: int, side: int) -> slice:
    """Those of some rows that the map has, as a slice that is not turned around."""
    start = min(max(start, 0), side)
    return slice(start, max(min(stop, side), start))
