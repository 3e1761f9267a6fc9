"""How lines share the shortening of a strip of skin: those around leaders give what these take."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.synthesis.lattice import Around
from rhytid.synthesis.progress import over_block, over_rows, row_blocks

Doubles = NDArray[np.float64]
# What others are left at least, of what they would take.
_LEFT = 0.2
# Pores that are looked around at a time: there are some hundred times as many pairs, each of which
# takes 40 bytes then, and 16 until all have asked.
_ASKING = 1 << 12
# How many times as many are found before their pairs are added up, in their order.
_AT_ONCE = 4
# Lines that are added up at pores at a time: a copy of them in other numbers stays in the cache.
_AT_ENDS = 1 << 14
_TINY = 1e-300
# Pairs of a pore that asks and one around it: which of the asking, which of all, how near.
_Pairs = tuple[NDArray[np.intp], NDArray[np.intp], Doubles]


@dataclass(frozen=True, eq=False)
class Strips:
    """W lines as they share the shortening of a strip of skin.

    edge (W,): that each draws.  pores (W, 2): that it joins.  weight (W,).  mass (W,): weight times
    half width times length.  position (N, 3): of the pores.  spacing: their mean distance on even
    skin.
    """

    edge: NDArray[np.int32]
    pores: NDArray[np.int32]
    weight: NDArray[np.float32]
    mass: Doubles
    position: Doubles
    spacing: float

    def given(
        self, lead: NDArray[np.intp], takes: NDArray[np.floating], strip: Doubles
    ) -> tuple[Doubles, Doubles]:
        """(N,) what leaders get of what they ask for at each pore, 0 to 1, and (N,) what others
        give there, of what they would take by themselves.

        lead (L,): the lines that are parts of leaders.  takes (L,): how much more each asks for
        than it would take by itself, of that. It asks the pores around it, in proportion to what
        meets there and to how near they are, and each gives as far as it can.  strip (L,): how far
        it asks, in pore spacings.
        """
        count = len(self.position)
        leading, others = self.pores[lead], self.mass.copy()
        others[lead] = 0.0
        there = _at_pores(self.pores, others, count)
        del others
        asked, farthest = _at_pores(leading, self.mass[lead] * takes, count), np.zeros(count)
        np.maximum.at(farthest, leading, strip[:, None])
        asking, asks, of_all = np.flatnonzero(asked > 0), [], np.zeros(count)
        for some, (one, two, near) in self._pairs(asking, farthest[asking]):
            offered = near * there[two]
            total = np.maximum(np.bincount(one, offered, len(some)), _TINY)
            offered *= (asked[some] / total)[one]
            np.add.at(of_all, two, offered)
            asks.append((some, one.astype(np.int32), two.astype(np.int32), offered))
        of_all /= np.maximum(there, _TINY)
        least, got = np.minimum(1.0, (1.0 - _LEFT) / np.maximum(of_all, _TINY)), np.zeros(count)
        for some, of, by, offered in asks:
            got[some] = np.bincount(of, offered * least[by], len(some))
        got /= np.maximum(asked, _TINY)
        of_all *= least
        return got, of_all

    def _pairs(
        self, asking: NDArray[np.intp], farthest: Doubles
    ) -> Iterator[tuple[NDArray[np.intp], _Pairs]]:
        """Some of the pores that ask for something (A,), and the pairs of these and those around
        them, ordered; nearness is 1 to 0.  farthest (A,): how far each asks, in pore spacings."""
        if not len(asking):
            return
        # Trees that are asked once are not worth balancing.
        quick = {"balanced_tree": False, "compact_nodes": False}
        around = Around(self.position[asking], float(farthest.max()) * self.spacing)
        others = around.all_near(self.position)
        every = scipy.spatial.cKDTree(self.position[others], **quick)
        found: dict[int, tuple[NDArray[np.intp], _Pairs]] = {}

        def find(rows: slice) -> None:
            some, parts = asking[rows], []
            for reach in np.unique(farthest[rows]):
                of = np.flatnonzero(farthest[rows] == reach)
                tree = scipy.spatial.cKDTree(self.position[some[of]], **quick)
                reach *= self.spacing
                near = tree.sparse_distance_matrix(every, reach, output_type="ndarray")
                nearness = (1.0 - (near["v"] / reach) ** 2) ** 2
                parts.append((of[near["i"]], others[near["j"]], nearness))
            one, two, nearness = (np.concatenate(part) for part in zip(*parts, strict=True))
            order = np.argsort(one * len(self.position) + two)
            found[rows.start] = some, (one[order], two[order], nearness[order])

        for block in row_blocks(len(asking), _AT_ONCE * _ASKING):
            over_block(block, find, _ASKING)
            yield from (found.pop(first) for first in sorted(found))


def _at_pores(ends: NDArray[np.int32], values: Doubles, count: int) -> Doubles:
    """(N,) sums of values (W,) at pores, half of each at either of its ends (W, 2)."""
    sums = np.zeros((2, count))

    def add(side: slice) -> None:
        for rows in row_blocks(len(ends), _AT_ENDS):
            np.add.at(sums[side.start], ends[rows, side.start], values[rows])

    over_rows(2, add, each=1)
    return np.asarray(0.5 * (sums[0] + sums[1]), np.float64)
