"""Strands: lines that continue one another, each part of which is by chance fainter or stronger."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.hashes import Words, normals, place_keys
from rhytid.synthesis.lines import NOTHING, Indices, Lines
from rhytid.synthesis.progress import over_rows, rows_where
from rhytid.synthesis.surface import Points

Singles = NDArray[np.float32]
# Lines that continue one another are a strand. Where skin folds one way strands run side by side,
# as far apart as pores are: were they alike, they would be a fabric. So each part of one is by
# chance fainter or stronger. Deviation of the logarithm of weights where lines are as uneven as
# can be; widths follow by this power.
UNEVEN, UNEVEN_WIDTH = 1.2, 0.35
# So far around, in lines along a strand, the first of them by chance decides for all; and how often
# neighbours on it are averaged, so that its parts fade into one another.
_STEPS, _SOFTENED = 6, 2
# So that random numbers for this are others than for another purpose.
_PART = 21


def unevenness(
    pores: Points, lines: Lines, partners: Indices, amount: Singles, seed: int
) -> tuple[Singles, Singles]:
    """(W,) factors of the weights and of the widths of stored lines; 1 where `amount` is 0, else
    most below it: fewer lines are left.

    partners (W, 2): the line that continues each at its ends, below 0 for none.  amount (W,): how
    far strands differ, 0 to 1.
    """
    factor, whole = np.ones(len(lines.edge), np.float32), lines.whole
    narrower = np.ones(len(lines.edge), np.float32)
    of = rows_where(whole, lambda rows: amount[rows] > 0)
    beside, places = _beside(lines, partners, of), place_keys(pores.uv)
    key = np.empty(len(of), np.uint32)

    def mark(rows: slice) -> None:
        one, two = lines.pores[of[rows]].T
        key[rows] = places[one] ^ places[two]

    over_rows(len(of), mark)
    chance = normals(_first(key, beside), _PART, seed)
    for _ in range(_SOFTENED):
        chance = _over_strands(chance, beside, _mean)

    def find(rows: slice) -> None:
        deviation = np.float32(UNEVEN) * amount[of[rows]]
        factor[of[rows]] = found = np.exp(deviation * (chance[rows] - deviation))
        narrower[of[rows]] = found ** np.float32(UNEVEN_WIDTH)

    over_rows(len(of), find)
    for values in (factor, narrower):
        values[whole:] = values[lines.copy_of[whole:]]
    return factor, narrower


def _beside(lines: Lines, partners: Indices, of: Indices) -> Indices:
    """(K, 2) of wrinkles `of` (K,), which of these come before and after each on its strand; itself
    where none does."""
    whole, found = lines.whole, np.empty((len(of), 2), np.int32)
    # A wrinkle over a seam goes on where its second half does.
    second = np.full(whole, -1, np.int32)
    second[lines.copy_of[whole:]] = np.arange(whole, len(lines.edge))
    number = np.full(whole + 1, -1, np.int32)
    number[of] = np.arange(len(of), dtype=np.int32)

    def find(rows: slice) -> None:
        next_to, other = partners[of[rows]], second[of[rows]]
        cut = np.flatnonzero(other >= 0)
        next_to[cut, 1] = partners[other[cut], 1]
        beyond = next_to >= whole
        next_to[beyond] = lines.copy_of[next_to[beyond]]
        own = np.arange(rows.start, rows.start + len(next_to), dtype=np.int32)
        at = number[np.maximum(next_to, NOTHING)]
        found[rows] = np.where(at < 0, own[:, None], at)

    over_rows(len(of), find)
    return found


def _first(key: Words, beside: Indices) -> Words:
    """(K,) the least of the keys (K,) within _STEPS of each on its strand."""
    for _ in range(_STEPS):
        key = _over_strands(key, beside, _least)
    return key


def _over_strands(
    values: NDArray[Any], beside: Indices, join: Callable[..., NDArray[Any]]
) -> NDArray[Any]:
    """(K,) each value joined with those before and after it on its strand."""
    found = np.empty_like(values)

    def find(rows: slice) -> None:
        before, after = beside[rows].T
        found[rows] = join(values[rows], values[before], values[after])

    over_rows(len(found), find)
    return found


def _least(own: Words, before: Words, after: Words) -> Words:
    found: Words = np.minimum(own, np.minimum(before, after))
    return found


def _mean(own: Singles, before: Singles, after: Singles) -> Singles:
    found: Singles = (own + before + after) / np.float32(3.0)
    return found
