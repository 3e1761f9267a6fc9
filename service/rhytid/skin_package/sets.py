"""Codes of the samples of a bin, texel by texel, as numbers of few sets: far fewer sets occur than
there could be, so that a texel takes two bytes for all samples. Exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError

Codes = NDArray[np.int8]
# Columns of the array of the sets, and rows that every WebGL2 takes.
A_ROW, MOST_ROWS = 1024, 2048


def in_sets(
    levels: Sequence[NDArray[np.integer]], samples: int
) -> tuple[list[NDArray[np.uint32]], Codes]:
    """Maps (N·S, n, n) int8 of every level, of each bin those of its S samples, as numbers of sets,
    (N, n, n) of every level; and the codes of the sets, (S, rows, 1024): set i at row i // 1024,
    column i % 1024.

    Raises LimitError where there are more sets than WebGL2 has texels for.
    """
    bins = [level.reshape(-1, samples, *level.shape[1:]).view(np.uint8) for level in levels]
    numbers = [maps[:, 0].astype(np.uint32) for maps in bins]
    sets = np.arange(256, dtype=np.uint8)[None]
    for sample in range(1, samples):
        there = np.zeros(sets.shape[1] << 8, bool)
        for number, maps in zip(numbers, bins, strict=True):
            number <<= 8
            number |= maps[:, sample]
            there[number] = True
        found = np.flatnonzero(there)
        if len(found) > A_ROW * MOST_ROWS:
            raise LimitError(
                f"{len(found)} sets of codes are more than a texture holds, "
                f"{A_ROW * MOST_ROWS}: a lower resolution has fewer"
            )
        place = np.cumsum(there, dtype=np.uint32) - 1
        for number in numbers:
            number[...] = place[number]
        sets = np.concatenate([sets[:, found >> 8], (found & 255).astype(np.uint8)[None]])
    rows = -(-sets.shape[1] // A_ROW)
    codes = np.zeros((samples, rows * A_ROW), np.int8)
    codes[:, : sets.shape[1]] = sets.view(np.int8)
    return numbers, codes.reshape(samples, rows, A_ROW)
