"""Follows elements over UV seams, from chart to chart."""

from __future__ import annotations

import numpy as np

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
_Pairs = tuple[IntArray, IntArray, FloatArray]


class Search:
    """Finds twins of elements, one after the other.  borders, places: those of the mesh."""

    def __init__(self, borders: Borders, places: BorderPlaces) -> None:
        self._borders, self._places = borders, places

    def twins(self, supports: Supports, counts: float) -> Twins:
        """All that each needs, in the order of the elements.  counts: see `over_seams`."""
        drawn = Twins.originals(np.arange(len(supports)))
        active = np.arange(len(supports))
        for _ in range(_MOST - 1):
            more = self._next(supports, drawn, active, counts)
            if not len(more):
                break
            active = more.of
            drawn = Twins.join([drawn, more])
        twins = drawn.take(np.flatnonzero(drawn.side != NONE)).sorted()
        return twins.take(self._wanted(supports, twins))

    def _next(self, supports: Supports, drawn: Twins, active: IntArray, counts: float) -> Twins:
        """One more of each active element where it reaches over a seam and is not yet drawn: over
        the seam that is nearest to one of those drawn."""
        asking = np.flatnonzero(np.isin(drawn.of, active))
        who, place, near = self.within(supports, drawn.take(asking))
        who = asking[who]
        further = np.where(drawn.nearest[who] < 1.0, _AGAIN, 0.0)
        widest = supports.widest[drawn.of[who]]
        reached = near < np.where(drawn.side[who] == NONE, widest, further)
        pairs = who[reached], place[reached], near[reached]
        missing = ~self._covered(supports, drawn, pairs)
        who, place, near = who[reached][missing], place[reached][missing], near[reached][missing]
        more = over_seams(self._borders, self._places, supports, drawn, (who, place, near), counts)
        more = more.take(self._apart(supports, drawn, more))
        return more.take(self._round(supports, more))

    def within(self, supports: Supports, drawn: Twins) -> _Pairs:
        """(P,) of `drawn`, (P,) places on seams of their charts that these may reach, and (P,) how
        far away, in sizes."""
        who, place = self._places.reached(supports, drawn)
        charts = drawn.charts(supports, self._borders)
        seam = ~self._places.open[place] & (self._places.chart[place] == charts[who])
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

    def _covered(self, supports: Supports, drawn: Twins, pairs: _Pairs) -> BoolArray:
        """(P,) whether an element lies on the far side of a seam already as it should."""
        who, place, near = pairs
        covered = np.zeros(len(who), np.bool_)
        for rows, other in _others(drawn, drawn.of[who]):
            rows, other = rows[~covered[rows]], other[~covered[rows]]
            there = drawn.back(other, self._places.there[place[rows]])
            gap = np.abs(supports.distance(drawn.of[other], there) - near[rows])
            covered[rows] = gap <= _ABOUT + _SHARE * near[rows]
        return covered

    def _wanted(self, supports: Supports, twins: Twins) -> IntArray:
        """Rows of the twins without those that would be seen in a chart that they do not belong to
        before they reach their own."""
        far = np.flatnonzero(twins.nearest >= 1.0)
        asked = twins.take(far)
        who, place = self._places.reached(supports, asked)
        charts = asked.charts(supports, self._borders)
        foreign = self._places.chart[place] != charts[who]
        near = supports.distance(asked.of[who], asked.back(who, self._places.here[place]))
        stray = near < np.where(foreign, 1.0, _NEARER) * asked.nearest[who]
        stray = np.unique(far[who[stray]])
        return np.setdiff1d(np.arange(len(twins)), stray)


def _others(drawn: Twins, of: IntArray) -> list[tuple[IntArray, IntArray]]:
    """For the first, second, ... of `drawn` of each element: the rows of `of` (N,) whose element
    has so many, and which of `drawn` that is."""
    order = np.argsort(drawn.of, kind="stable")
    first = np.searchsorted(drawn.of[order], of)
    count = np.searchsorted(drawn.of[order], of, "right") - first
    turns = range(int(count.max(initial=0)))
    rows = (np.flatnonzero(turn < count) for turn in turns)
    return [(some, order[first[some] + turn]) for turn, some in zip(turns, rows, strict=True)]
