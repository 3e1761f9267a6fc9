"""Strands, lines that continue one another, and how far each part of one is by chance fainter or
stronger than what lies beside it.

Where skin folds one way lines run side by side, as far apart as pores are: were they alike, they
would be a fabric. Some are left out, some stand out, each for some pore spacings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.hashes import Words, normals, place_keys
from rhytid.synthesis.lines import NOTHING, Indices, Lines
from rhytid.synthesis.surface import Points

Singles = NDArray[np.float32]
# Deviation of the logarithm of weights where lines are as uneven as can be; widths follow by this
# power.
DEVIATION, WIDTH = 1.2, 0.35
# So far around, in lines along a strand, the first of them by chance decides for all.
STEPS = 6
# How often neighbours on a strand are averaged, so that its parts fade into one another.
_SOFTENED = 2
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
    of = np.flatnonzero(amount[:whole] > 0)
    beside, key = _beside(lines, partners, of), place_keys(pores.uv)[lines.pores[of]]
    chance = normals(_first(key[:, 0] ^ key[:, 1], beside), _PART, seed)
    for _ in range(_SOFTENED):
        chance = (chance + chance[beside[:, 0]] + chance[beside[:, 1]]) / np.float32(3.0)
    deviation = np.float32(DEVIATION) * amount[of]
    factor[of] = np.exp(deviation * (chance - deviation))
    factor[whole:] = factor[lines.copy_of[whole:]]
    return factor, factor ** np.float32(WIDTH)


def _beside(lines: Lines, partners: Indices, of: NDArray[np.intp]) -> Indices:
    """(K, 2) of wrinkles `of` (K,), which of these come before and after each on its strand; itself
    where none does."""
    found = partners[of]
    # A wrinkle over a seam goes on where its second half does.
    second = np.full(lines.whole, -1, np.int32)
    second[lines.copy_of[lines.whole :]] = np.arange(lines.whole, len(lines.edge))
    cut = np.flatnonzero(second[of] >= 0)
    found[cut, 1] = partners[second[of[cut]], 1]
    beyond = found >= lines.whole
    found[beyond] = lines.copy_of[found[beyond]]
    number = np.full(lines.whole + 1, -1, np.int32)
    number[of] = np.arange(len(of))
    found = number[np.maximum(found, NOTHING)]
    return np.where(found < 0, np.arange(len(of), dtype=np.int32)[:, None], found)


def _first(key: Words, beside: Indices) -> Words:
    """(K,) the least of the keys (K,) within STEPS of each on its strand."""
    least = key
    for _ in range(STEPS):
        least = np.minimum(least, np.minimum(least[beside[:, 0]], least[beside[:, 1]]))
    return least
