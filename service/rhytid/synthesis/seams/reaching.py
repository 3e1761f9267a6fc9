"""What reaches over a UV seam, and where it lies in the charts across."""

from __future__ import annotations

import numpy as np

from rhytid.synthesis.seams.agreement import agreeing
from rhytid.synthesis.seams.border_places import MOST_PAIRS, BorderPlaces, TooManyPairs
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.search import Search
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import FloatArray, IntArray

# Borders are looked at in places so many pore spacings apart.
PLACES = 0.15
# Supports are followed to 4 times their neutral size, which is as wide as any response makes them,
# and a little further, for borders are looked at in places.
FURTHER = 0.25
WIDEST = 4.0 + FURTHER
# How far beyond the nearest place of a seam a map from chart to chart is fitted to it, in sizes.
# Where that leaves both sides apart by more than _APART the others are tried: places that count the
# more, or the less, the farther they are.
_COUNTS, _OTHERS, _APART = 2.0, (0.7, 4.0, 8.0), 0.1
# Of these one that leaves less than this share of the error is taken.
_BETTER = 0.95
# Elements that are looked at together, unless they reach too many places, and how many times as
# many of these their twins are counted to reach.
_BLOCK, _TWINS = 1 << 13, 4


class Seams:
    """The seams of a mesh, to ask what reaches over them.  apart: of places, on the surface."""

    def __init__(self, borders: Borders, apart: float) -> None:
        self._borders = borders
        self._places = BorderPlaces.on(borders, apart)
        self._search = Search(borders, self._places)

    def twins(self, supports: Supports) -> Twins:
        """What is to be drawn beside the elements, in the order of these."""
        blocks = self._blocks(supports)
        found = (self._within_limits(supports, some) for some in blocks)
        return Twins.join([Twins.originals(np.zeros(0, np.int64)), *found])

    def reaching(self, supports: Supports) -> IntArray:
        """Rows of what reaches a seam of its chart."""
        found = [np.zeros(0, np.int64)]
        for some in self._blocks(supports):
            one = supports.take(some)
            who, _, near = self._search.within(one, Twins.originals(np.arange(len(some))))
            found.append(some[np.unique(who[near < one.widest[who]])])
        return np.concatenate(found)

    def _blocks(self, supports: Supports) -> list[IntArray]:
        """Rows of what may reach a border, some at a time."""
        if self._places.open.all() or not len(supports):
            return []
        near = self._places.nearby(supports)
        if not len(near):
            return []
        # An element may come to have many twins, each of which reaches as much.
        load = np.cumsum(self._places.near(supports.take(near))) * _TWINS // MOST_PAIRS
        block = np.arange(len(near)) // _BLOCK + load
        return np.split(near, np.flatnonzero(np.diff(block)) + 1)

    def _within_limits(self, supports: Supports, some: IntArray) -> Twins:
        """Twins of the elements `some`, in halves of them where these reach too many places."""
        try:
            return self._best(supports.take(some)).renamed(some)
        except TooManyPairs:
            parts = np.array_split(some, 2)
            return Twins.join([self._within_limits(supports, half) for half in parts])

    def _best(self, supports: Supports) -> Twins:
        """Twins as both sides of a seam agree best with them, be lines drawn straight or bent."""
        found, error = self._tried(supports, False, _COUNTS)
        ways = [(False, counts) for counts in _OTHERS]
        if supports.slopes.any():
            ways += [(True, counts) for counts in (_COUNTS, *_OTHERS)]
        asked = np.flatnonzero(error > _APART)
        for bent, counts in ways:
            if not len(asked):
                break
            other, left = self._tried(supports.take(asked), bent, counts)
            better = left < _BETTER * error[asked]
            error[asked[better]] = left[better]
            other = other.take(better[other.of]).renamed(asked)
            found = Twins.join([found.take(~np.isin(found.of, asked[better])), other])
        return found.sorted()

    def _tried(self, supports: Supports, bent: bool, counts: float) -> tuple[Twins, FloatArray]:
        """Twins that are fitted in one way, less what is better left out, and (E,) errors."""
        drawn = supports if bent else supports.straight()
        found = self._search.twins(drawn, counts)
        kept, error = agreeing(self._borders, self._places, supports, found)
        return found.take(kept), error
