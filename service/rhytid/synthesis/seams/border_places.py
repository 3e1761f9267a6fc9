"""Places on the borders of charts, close to one another, to find there what reaches over them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from rhytid.support import cancellation
from rhytid.synthesis.arrays import row_blocks
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# What reaches more places than this is larger than the charts around it, and is not followed there:
# ordinary elements reach some hundred.
MOST_PLACES = 1 << 12
# Pairs of elements and places that are looked at together; what is more is looked at in parts.
MOST_PAIRS = 1 << 20
# Charts apart in the third coordinate of a tree, and the most that is asked for within one.
_APART, _FARTHEST = 1e4, 1e3


class TooManyPairs(Exception):
    """Several elements reach more places together than are looked at at once."""


@dataclass(frozen=True, eq=False)
class BorderPlaces:
    """S places on the borders of charts. row (S,): of the side.  here, there (S, 2): uv on it and
    on its mate.  following (S,): the next place along the seam, or NONE.  mate (S,): the place on
    the other side of the seam, itself where there is none.  open (S,): where there is none.
    chart (S,): that it is on.  tree: of all, by uv.  by_chart: by uv and chart.
    """

    row: IntArray
    here: FloatArray
    there: FloatArray
    following: IntArray
    mate: IntArray
    open: BoolArray
    chart: IntArray
    tree: cKDTree
    by_chart: cKDTree

    @classmethod
    def on(cls, borders: Borders, apart: float) -> BorderPlaces:
        """About `apart` from each other on the surface, two on a side at least."""
        count = np.maximum(np.ceil(borders.length / apart), 2.0).astype(np.int64)
        first = np.cumsum(count) - count
        row = np.repeat(np.arange(len(count)), count)
        at = np.arange(len(row)) - first[row]
        share = ((at + 0.5) / count[row])[:, None]
        here, there = (
            (1 - share) * ends[row, 0] + share * ends[row, 1]
            for ends in (borders.ends, borders.across)
        )
        following = np.arange(1, len(row) + 1)
        last, after = first + count - 1, borders.following
        following[last] = np.where(after == NONE, NONE, first[after])
        alone = borders.mate[row] == NONE
        # The mate runs the other way round.
        mate = np.where(alone, np.arange(len(row)), (first + count - 1)[borders.mate[row]] - at)
        chart = borders.chart[borders.triangle[row]]
        by_chart = cKDTree(np.column_stack([here, _APART * chart]))
        return cls(row, here, there, following, mate, alone, chart, cKDTree(here), by_chart)

    def __len__(self) -> int:
        return len(self.row)

    def nearby(self, supports: Supports) -> IntArray:
        """Rows of those that may reach a border."""
        reach = supports.reach()
        # What is farther away than any of them reaches is infinitely far.
        bound = np.nextafter(reach.max(initial=0.0), np.inf)
        middle, found = supports.middle(), [np.zeros(0, np.int64)]
        for rows in row_blocks(len(middle)):
            distance, _ = self.tree.query(middle[rows], distance_upper_bound=bound)
            found.append(rows.start + np.flatnonzero(distance <= reach[rows]))
        return np.concatenate(found)

    def near(self, supports: Supports) -> IntArray:
        """(E,) how many places of its chart each may reach."""
        middle, reach = supports.middle(), np.minimum(supports.reach(), _FARTHEST)
        counts: IntArray = self.by_chart.query_ball_point(
            np.column_stack([middle, _APART * supports.chart]), reach, return_length=True
        )
        return counts

    def reached(
        self, supports: Supports, twins: Twins, charts: IntArray | None = None
    ) -> tuple[IntArray, IntArray]:
        """(P,) of `twins` and (P,) places that each may reach: of its chart in `charts` (T,), or
        without them on whatever chart. None of those that reach more than MOST_PLACES.

        Raises TooManyPairs where P would be more than MOST_PAIRS, of more than one element.
        """
        cancellation.check()
        tree, at, reach = self._asked(supports, twins, charts)
        counts = tree.query_ball_point(at, reach, return_length=True)
        rows = np.flatnonzero((counts > 0) & (counts <= MOST_PLACES))
        if counts[rows].sum() > MOST_PAIRS and (twins.of[rows] != twins.of[rows[0]]).any():
            raise TooManyPairs
        found = tree.query_ball_point(at[rows], reach[rows], return_sorted=True)
        flat = np.fromiter(chain.from_iterable(found), np.int64, int(counts[rows].sum()))
        return np.repeat(rows, counts[rows]), flat

    def crowded(self, supports: Supports, twins: Twins) -> BoolArray:
        """(T,) which of `twins` reach more than MOST_PLACES places, on whatever chart."""
        tree, at, reach = self._asked(supports, twins, None)
        crowded: BoolArray = tree.query_ball_point(at, reach, return_length=True) > MOST_PLACES
        return crowded

    def _asked(
        self, supports: Supports, twins: Twins, charts: IntArray | None
    ) -> tuple[cKDTree, FloatArray, FloatArray]:
        """A tree, points in it, and within which distances of these places may be reached."""
        own = supports.take(twins.of)
        largest = np.linalg.svd(twins.turn, compute_uv=False)[:, 0]
        at, reach = twins.at(own.middle()), np.minimum(own.reach() * largest, _FARTHEST)
        if charts is None:
            return self.tree, at, reach
        return self.by_chart, np.column_stack([at, _APART * charts]), reach

    def runs(self, who: IntArray, place: IntArray) -> IntArray:
        """(P,) numbers of the stretches of seam that the pairs make up, of one element each."""
        size = len(self.row)
        key, following = who * size + place, self.following[place]
        order = np.argsort(key)
        wanted = who * size + following
        at = order[np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)]
        linked = np.flatnonzero((following != NONE) & (key[at] == wanted))
        links = coo_array(
            (np.ones(len(linked), np.int8), (linked, at[linked])), shape=(len(key), len(key))
        )
        run: IntArray = connected_components(links, directed=False)[1].astype(np.int64)
        return run
