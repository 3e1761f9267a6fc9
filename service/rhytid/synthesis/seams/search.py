"""Follows elements over UV seams, from chart to chart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhytid.support import cancellation
from rhytid.synthesis.seams.border_places import BorderPlaces
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.over_seams import LONGER, over_seams
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# Of one element at most so many are stored in all.
_MOST = 8
# An element that is so near in sizes of its own needs no other in this place: ABOUT, and SHARE of
# how far away it is.
_ABOUT, _SHARE = 0.5, 0.25
# Copies that are needed at their neutral size are followed over further seams, no further than
# this: how one chart goes on in the next is known only near their seam.
_AGAIN = 1.5
# What does not reach a seam at its neutral size is not stored again beside itself.
_BESIDE = 1.5
# It is not stored where it comes by so much nearer to another part of the border of its chart.
_NEARER = 0.7
# What two ways to compute a distance may differ by.
_ROUNDED = 1.001
_Pairs = tuple[IntArray, IntArray, FloatArray]


class Search:
    """Finds twins of elements, one after the other.  borders, places: those of the mesh."""

    def __init__(self, borders: Borders, places: BorderPlaces) -> None:
        self._borders, self._places = borders, places

    def twins(self, supports: Supports, counts: float) -> Twins:
        """All that each needs, in the order of the elements.  counts: see `over_seams`."""
        drawn = Twins.originals(np.arange(len(supports)))
        pairs = self._open(supports, drawn, 0)
        for _ in range(_MOST - 1):
            more = self._next(supports, drawn, pairs, counts)
            if not len(more):
                break
            first, drawn = len(drawn), Twins.join([drawn, more])
            pairs = self._left(supports, drawn, first, pairs)
        twins = drawn.take(np.flatnonzero(drawn.side != NONE)).sorted()
        return twins.take(self._wanted(supports, twins))

    def _next(self, supports: Supports, drawn: Twins, pairs: _Pairs, counts: float) -> Twins:
        """One more of each element where it reaches over a seam and is not yet drawn: over the seam
        that is nearest to one of those drawn.  pairs: see `_open`."""
        more = over_seams(self._borders, self._places, supports, drawn, pairs, counts)
        more = more.take(self._apart(supports, drawn, more))
        return more.take(self._round(supports, more))

    def _open(self, supports: Supports, drawn: Twins, first: int) -> _Pairs:
        """(P,) of `drawn` from row `first` on, (P,) places of seams that these reach and where
        nothing lies on the far side as it should, and (P,) how far away they are."""
        asking = np.arange(first, len(drawn))
        who, place, near = self.within(supports, drawn.take(asking))
        who = asking[who]
        further = np.where(drawn.nearest[who] < 1.0, _AGAIN, 0.0)
        widest = supports.widest[drawn.of[who]]
        reached = near < np.where(drawn.side[who] == NONE, widest, further)
        pairs = who[reached], place[reached], near[reached]
        return _some(pairs, ~self._covered(supports, drawn, np.arange(len(drawn)), pairs))

    def _left(self, supports: Supports, drawn: Twins, first: int, before: _Pairs) -> _Pairs:
        """As `_open`, of all twins of the elements of which there is one from row `first` on.

        before: those of the twins before `first`. What is covered stays so: they are compared with
        the new twins alone, and only the places that these reach with all.
        """
        new = np.arange(first, len(drawn))
        pairs = _some(before, np.isin(drawn.of[before[0]], drawn.of[new]))
        pairs = _some(pairs, ~self._covered(supports, drawn, new, pairs))
        found = self._open(supports, drawn, first)
        who, place, near = (np.concatenate(both) for both in zip(pairs, found, strict=True))
        return who, place, near

    def within(self, supports: Supports, drawn: Twins) -> _Pairs:
        """(P,) of `drawn`, (P,) places on seams of their charts that these may reach, and (P,) how
        far away, in sizes."""
        charts = drawn.charts(supports, self._borders)
        who, place = self._places.reached(supports, drawn, charts)
        seam = ~self._places.open[place]
        who, place = who[seam], place[seam]
        near = supports.distance(drawn.of[who], drawn.back(who, self._places.here[place]))
        return who, place, near

    def _round(self, supports: Supports, more: Twins) -> IntArray:
        """Rows of what is about as round on the surface across the seam as it was. It is not where
        charts are crumpled within the size of an element: it would reach far along them."""
        flat = self._borders.beyond[more.side] @ more.turn @ np.linalg.inv(supports.root[more.of])
        sizes = np.linalg.svd(flat, compute_uv=False)
        return np.flatnonzero(sizes[:, 0] < LONGER * sizes[:, 1])

    def _apart(self, supports: Supports, drawn: Twins, more: Twins) -> IntArray:
        """Rows of what is not nearly where the same element is drawn already, in the same chart,
        or is needed at its neutral size."""
        beside = np.zeros(len(more), np.bool_)
        chart, own = (twins.charts(supports, self._borders) for twins in (drawn, more))
        middle = more.at(supports.middle()[more.of])
        for rows, other in _others(drawn, more.of):
            asked = (more.nearest[rows] >= 1.0) & (chart[other] == own[rows])
            rows, other = rows[asked], other[asked]
            away = supports.distance(more.of[rows], drawn.back(other, middle[rows]))
            beside[rows] |= away < 1.0 + _BESIDE * more.nearest[rows]
        return np.flatnonzero(~beside)

    def _covered(self, supports: Supports, drawn: Twins, by: IntArray, pairs: _Pairs) -> BoolArray:
        """(P,) whether an element lies on the far side of a seam already as it should, as one of
        the rows `by` of those drawn."""
        who, place, near = pairs
        covered = np.zeros(len(who), np.bool_)
        for rows, other in _others(drawn.take(by), drawn.of[who]):
            cancellation.check()
            rows, other = rows[~covered[rows]], by[other[~covered[rows]]]
            there = drawn.back(other, self._places.there[place[rows]])
            gap = np.abs(supports.distance(drawn.of[other], there) - near[rows])
            covered[rows] = gap <= _ABOUT + _SHARE * near[rows]
        return covered

    def _wanted(self, supports: Supports, twins: Twins) -> IntArray:
        """Rows of the twins without those that would be seen in a chart that they do not belong to
        before they reach their own, or among more borders than are looked at."""
        far = np.flatnonzero(twins.nearest >= 1.0)
        asked = twins.take(far)
        # No farther than their own seams.
        widest = np.zeros(len(supports))
        np.maximum.at(widest, asked.of, _ROUNDED * asked.nearest)
        close = replace(supports, widest=widest)
        who, place = self._places.reached(close, asked)
        charts = asked.charts(supports, self._borders)
        foreign = self._places.chart[place] != charts[who]
        near = supports.distance(asked.of[who], asked.back(who, self._places.here[place]))
        stray = near < np.where(foreign, 1.0, _NEARER) * asked.nearest[who]
        crowded = self._places.crowded(close, asked)
        stray = np.union1d(far[who[stray]], far[crowded])
        return np.setdiff1d(np.arange(len(twins)), stray)


def _some(pairs: _Pairs, kept: BoolArray) -> _Pairs:
    """Those of a mask, in their order."""
    who, place, near = pairs
    return who[kept], place[kept], near[kept]


def _others(drawn: Twins, of: IntArray) -> list[tuple[IntArray, IntArray]]:
    """For the first, second, ... of `drawn` of each element: the rows of `of` (N,) whose element
    has so many, and which of `drawn` that is."""
    order = np.argsort(drawn.of, kind="stable")
    first = np.searchsorted(drawn.of[order], of)
    count = np.searchsorted(drawn.of[order], of, "right") - first
    turns = range(int(count.max(initial=0)))
    rows = (np.flatnonzero(turn < count) for turn in turns)
    return [(some, order[first[some] + turn]) for turn, some in zip(turns, rows, strict=True)]
