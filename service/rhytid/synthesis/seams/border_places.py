"""Places on the borders of charts, close to one another, to find there what reaches over them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy

from rhytid.support import cancellation
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.footprints import Footprints, Placements
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# What reaches more places than this is larger than the charts around it, and is not followed there:
# ordinary elements reach some hundred.
MOST_PLACES = 1 << 12
# Pairs of elements and places that are looked at together; what is more is looked at in parts.
MOST_PAIRS = 1 << 20
# Charts apart in the third coordinate of a tree, and the most that is asked for within one.
_APART, _FARTHEST = 1e4, 1e3


class TooManyPairs(Exception):
    """Several elements together reach more places than MOST_PAIRS allows at once."""


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
    tree: scipy.spatial.cKDTree
    by_chart: scipy.spatial.cKDTree

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
        by_chart = scipy.spatial.cKDTree(np.column_stack([here, _APART * chart]))
        return cls(
            row, here, there, following, mate, alone, chart, scipy.spatial.cKDTree(here), by_chart
        )

    def __len__(self) -> int:
        return len(self.row)

    def nearby(self, footprints: Footprints) -> IntArray:
        """Rows of the elements that may reach a border."""
        reach = footprints.reach()
        # What is farther away than any of them reaches is infinitely far.
        bound = np.nextafter(reach.max(initial=0.0), np.inf)
        middle, found = footprints.middle(), [np.zeros(0, np.int64)]
        for rows in row_blocks(len(middle)):
            distance, _ = self.tree.query(middle[rows], distance_upper_bound=bound)
            found.append(rows.start + np.flatnonzero(distance <= reach[rows]))
        return np.concatenate(found)

    def near(self, footprints: Footprints) -> IntArray:
        """(E,) how many places of its own chart each element may reach."""
        middle, reach = footprints.middle(), np.minimum(footprints.reach(), _FARTHEST)
        counts: IntArray = self.by_chart.query_ball_point(
            np.column_stack([middle, _APART * footprints.chart]), reach, return_length=True
        )
        return counts

    def reached(
        self, footprints: Footprints, placements: Placements, charts: IntArray | None = None
    ) -> tuple[IntArray, IntArray]:
        """Pairs of a placement and a place that it may reach: rows (P,) of both.

        charts (T,): of the placements; places of other charts are left out. Without it every place
        counts. Placements that reach more than MOST_PLACES are left out.
        Raises TooManyPairs where P would be above MOST_PAIRS and the pairs are of several elements.
        """
        cancellation.check()
        tree, at, reach = self._asked(footprints, placements, charts)
        counts = tree.query_ball_point(at, reach, return_length=True)
        rows = np.flatnonzero((counts > 0) & (counts <= MOST_PLACES))
        if (
            counts[rows].sum() > MOST_PAIRS
            and (placements.of[rows] != placements.of[rows[0]]).any()
        ):
            raise TooManyPairs
        found = tree.query_ball_point(at[rows], reach[rows], return_sorted=True)
        flat = np.fromiter(chain.from_iterable(found), np.int64, int(counts[rows].sum()))
        return np.repeat(rows, counts[rows]), flat

    def crowded(self, footprints: Footprints, placements: Placements) -> BoolArray:
        """(T,) whether each placement reaches more than MOST_PLACES places, of all charts."""
        tree, at, reach = self._asked(footprints, placements, None)
        crowded: BoolArray = tree.query_ball_point(at, reach, return_length=True) > MOST_PLACES
        return crowded

    def _asked(
        self, footprints: Footprints, placements: Placements, charts: IntArray | None
    ) -> tuple[scipy.spatial.cKDTree, FloatArray, FloatArray]:
        """A tree of places, points (T, ...) in it, and the distances (T,) to look within."""
        own = footprints.take(placements.of)
        largest = np.linalg.svd(placements.turn, compute_uv=False)[:, 0]
        at, reach = placements.at(own.middle()), np.minimum(own.reach() * largest, _FARTHEST)
        if charts is None:
            return self.tree, at, reach
        return self.by_chart, np.column_stack([at, _APART * charts]), reach

    def runs(self, item: IntArray, place: IntArray) -> IntArray:
        """(P,) the number of the stretch of seam that each pair is part of. The places of a stretch
        follow one another along the seam and are reached by the same placement."""
        size = len(self.row)
        key, following = item * size + place, self.following[place]
        order = np.argsort(key)
        next_key = item * size + following
        at = order[np.minimum(np.searchsorted(key, next_key, sorter=order), len(key) - 1)]
        linked = np.flatnonzero((following != NONE) & (key[at] == next_key))
        links = scipy.sparse.coo_array(
            (np.ones(len(linked), np.int8), (linked, at[linked])), shape=(len(key), len(key))
        )
        run: IntArray = scipy.sparse.csgraph.connected_components(links, directed=False)[1].astype(
            np.int64
        )
        return run
