"""Places on the borders of charts, close to one another, to find there what reaches over them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class BorderPlaces:
    """S places on the borders of charts. row (S,): of the side.  here, there (S, 2): uv on it and
    on its mate.  following (S,): the next place along the seam, or NONE.  mate (S,): the place on
    the other side of the seam, itself where there is none.  open (S,): where there is none.
    chart (S,): that it is on.
    """

    row: IntArray
    here: FloatArray
    there: FloatArray
    following: IntArray
    mate: IntArray
    open: BoolArray
    chart: IntArray
    tree: cKDTree

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
        return cls(row, here, there, following, mate, alone, chart, cKDTree(here))

    def __len__(self) -> int:
        return len(self.row)

    def nearby(self, supports: Supports) -> IntArray:
        """Rows of those that may reach a border."""
        reach = supports.reach()
        # What is farther away than any of them reaches is infinitely far.
        bound = np.nextafter(reach.max(initial=0.0), np.inf)
        distance, _ = self.tree.query(supports.middle(), distance_upper_bound=bound)
        return np.flatnonzero(distance <= reach)

    def reached(self, supports: Supports, twins: Twins) -> tuple[IntArray, IntArray]:
        """(P,) of `twins` and (P,) places that each may reach, on whatever chart."""
        own = supports.take(twins.of)
        largest = np.linalg.svd(twins.turn, compute_uv=False)[:, 0]
        found = self.tree.query_ball_point(
            twins.at(own.middle()), own.reach() * largest, return_sorted=True
        )
        counts = np.fromiter(map(len, found), np.int64, len(found))
        flat = np.fromiter(chain.from_iterable(found), np.int64, int(counts.sum()))
        return np.repeat(np.arange(len(found)), counts), flat

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
