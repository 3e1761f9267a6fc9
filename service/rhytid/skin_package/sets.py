"""Codes of the samples of a bin, texel by texel, as numbers of few sets: far fewer sets occur than
there could be, so that a texel takes two bytes for all samples. Exact."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError
from rhytid.support import cancellation

Codes = NDArray[np.int8]
Pairs = NDArray[np.uint32]
# Columns of the array of the sets, and rows that every WebGL2 takes.
A_ROW, MOST_ROWS = 1024, 2048
# Values that a table has at once, and texels that are taken at once.
TABLE, STRIP = 1 << 23, 1 << 18
# Bytes that `in_sets` takes beside its numbers, at most: tables, strips, and the sets.
BESIDE = 5 * TABLE + 32 * STRIP + 32 * A_ROW * MOST_ROWS


def in_sets(
    levels: Sequence[NDArray[np.integer]], samples: int
) -> tuple[list[NDArray[np.uint32]], Codes]:
    """Maps (N·S, n, n) int8 of every level, of each bin those of its S samples, as numbers of sets,
    (N, n, n) of every level; and the codes of the sets, (S, rows, 1024): set i at row i // 1024,
    column i % 1024.

    Takes four bytes a texel of a bin for the numbers, and at most BESIDE. Raises LimitError where
    there are more sets than WebGL2 has texels for.
    """
    bins = [level.reshape(-1, samples, *level.shape[1:]).view(np.uint8) for level in levels]
    numbers = [maps[:, 0].astype(np.uint32) for maps in bins]
    sets = np.arange(256, dtype=np.uint8)[None]
    for sample in range(1, samples):
        # In place: the number of the set of the samples before and this code, as one value.
        for number, code in zip(_strips(numbers), _strips(m[:, sample] for m in bins), strict=True):
            number <<= 8
            number |= code
        found = _found(numbers, sets.shape[1] << 8)
        place = _places(found, sets.shape[1] << 8)
        for number in _strips(numbers):
            number[...] = place(number)
        sets = np.concatenate([sets[:, found >> 8], (found & 255).astype(np.uint8)[None]])
    rows = -(-sets.shape[1] // A_ROW)
    codes = np.zeros((samples, rows * A_ROW), np.int8)
    codes[:, : sets.shape[1]] = sets.view(np.int8)
    return numbers, codes.reshape(samples, rows, A_ROW)


def _strips(levels: Iterable[NDArray[np.unsignedinteger]]) -> Iterator[NDArray[np.unsignedinteger]]:
    """Views of (N, n, n) of every level, STRIP texels at a time."""
    for level in levels:
        for one in level:
            flat = one.reshape(-1)
            for at in range(0, flat.size, STRIP):
                cancellation.check()
                yield flat[at : at + STRIP]


def _found(numbers: list[Pairs], end: int) -> Pairs:
    """The values below `end` that occur, in order; raises LimitError where they are too many."""
    found, count = [], 0
    for first in range(0, end, TABLE):
        there = np.zeros(min(TABLE, end - first), bool)
        for values in _strips(numbers):
            # What is below `first` wraps round to numbers beyond every table.
            within = values - np.uint32(first)
            there[within if end <= TABLE else within[within < len(there)]] = True
        found.append((np.flatnonzero(there) + first).astype(np.uint32))
        count += len(found[-1])
        if count > A_ROW * MOST_ROWS:
            raise LimitError(
                f"at least {count} sets of codes are more than a texture holds, "
                f"{A_ROW * MOST_ROWS}: a lower resolution has fewer"
            )
    return np.concatenate(found)


def _places(found: Pairs, end: int) -> Callable[[Pairs], NDArray[np.integer]]:
    """What tells the index of values in `found`, which has them: by a table where that is small."""
    if end > TABLE:
        return lambda values: np.searchsorted(found, values)
    table = np.zeros(end, np.uint32)
    table[found] = np.arange(len(found), dtype=np.uint32)
    return lambda values: table[values]
