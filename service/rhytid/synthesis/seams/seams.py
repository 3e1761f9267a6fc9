"""What reaches over a UV seam, where it lies in the charts across, and which of its placements
bring the two sides of a seam closest to each other."""

from __future__ import annotations

from itertools import product

import numpy as np

from rhytid.support import cancellation
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.seams.border_places import MOST_PAIRS, BorderPlaces, TooManyPairs
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.footprints import Footprints, Placements
from rhytid.synthesis.seams.search import Search
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# Borders are looked at in places so many pore spacings apart.
PLACES = 0.15
# Footprints are followed to 4 times their neutral size, which is as wide as any response makes
# them, and a little further, for borders are looked at in places.
FURTHER = 0.25
WIDEST = 4.0 + FURTHER
# How far beyond the nearest place of a seam a map from chart to chart is fitted to it, in sizes.
# Where that leaves both sides apart by more than _APART the others are tried: places that count the
# more, or the less, the farther they are.
_COUNTS, _OTHERS, _APART = 2.0, (0.7, 4.0, 8.0), 0.1
# Of these one that leaves less than this share of the error is taken.
_BETTER = 0.95
# Elements that are looked at together, unless they reach too many places, and how many times as
# many of these their placements are counted to reach.
_BLOCK, _PLACEMENTS = 1 << 13, 4
# Elements are looked at in so many times their neutral size; larger ones count less.
_SIZES = (1.0, 2.0, 4.0)
# Copies are left out where both sides then differ by less than this share of the error.
_CLEARLY_BETTER = 0.8


class Seams:
    """The seams of a mesh, and the elements that reach over them.

    apart: between places on the borders, on the surface.
    """

    def __init__(self, borders: Borders, apart: float) -> None:
        self._borders = borders
        self._places = BorderPlaces.on(borders, apart)
        self._search = Search(borders, self._places)

    def placements(self, footprints: Footprints, progress: Progress = silent) -> Placements:
        """The placements of elements in other charts than their own, in the order of the
        elements."""
        blocks, found = self._blocks(footprints), [Placements.originals(np.zeros(0, np.int64))]
        for done, some in enumerate(blocks):
            progress(done / len(blocks), "seams")
            found.append(self._within_limits(footprints, some))
        return Placements.join(found)

    def reaching(self, footprints: Footprints) -> IntArray:
        """Rows of the footprints that reach a seam of their chart."""
        found = [np.zeros(0, np.int64)]
        for some in self._blocks(footprints):
            one = footprints.take(some)
            item, _, near = self._search.within(one, Placements.originals(np.arange(len(some))))
            found.append(some[np.unique(item[near < one.widest[item]])])
        return np.concatenate(found)

    def nearby(self, footprints: Footprints) -> IntArray:
        """Rows of the footprints that may reach a border, where there are seams."""
        if self._places.open.all() or not len(footprints):
            return np.zeros(0, np.int64)
        return self._places.nearby(footprints)

    def _blocks(self, footprints: Footprints) -> list[IntArray]:
        """Rows of the footprints that may reach a border, a block of them at a time."""
        near = self.nearby(footprints)
        if not len(near):
            return []
        # An element may come to have many placements, each of which reaches as much.
        load = np.cumsum(self._places.near(footprints.take(near))) * _PLACEMENTS // MOST_PAIRS
        block = np.arange(len(near)) // _BLOCK + load
        return np.split(near, np.flatnonzero(np.diff(block)) + 1)

    def _within_limits(self, footprints: Footprints, some: IntArray) -> Placements:
        """The placements of the elements `some`; found for halves of them where together they reach
        too many places."""
        try:
            return self._best(footprints.take(some)).renamed(some)
        except TooManyPairs:
            parts = np.array_split(some, 2)
            return Placements.join([self._within_limits(footprints, half) for half in parts])

    def _best(self, footprints: Footprints) -> Placements:
        """The placements with which both sides of a seam agree best, lines being straight or
        bent."""
        found, error = self._tried(footprints, False, _COUNTS)
        ways = [(False, counts) for counts in _OTHERS]
        if footprints.slopes.any():
            ways += [(True, counts) for counts in (_COUNTS, *_OTHERS)]
        asked = np.flatnonzero(error > _APART)
        for bent, counts in ways:
            if not len(asked):
                break
            other, left = self._tried(footprints.take(asked), bent, counts)
            better = left < _BETTER * error[asked]
            error[asked[better]] = left[better]
            other = other.take(better[other.of]).renamed(asked)
            found = Placements.join([found.take(~np.isin(found.of, asked[better])), other])
        return found.sorted()

    def _tried(
        self, footprints: Footprints, bent: bool, counts: float
    ) -> tuple[Placements, FloatArray]:
        """The placements that are fitted in one way, without those that are better left out, and
        errors (E,)."""
        drawn = footprints if bent else footprints.straight()
        found = self._search.placements(drawn, counts)
        kept, error = agreeing(self._borders, self._places, footprints, found)
        return found.take(kept), error


def agreeing(
    borders: Borders, places: BorderPlaces, footprints: Footprints, placements: Placements
) -> tuple[IntArray, FloatArray]:
    """Rows of the placements that are worth drawing, and (E,) by how much the two sides of seams
    then differ, in depths times the root of the number of places.

    Where charts are crumpled a placement may be right at the seam that it comes over and wrong
    along the next: two sides agree better without it.  placements: in the order of the elements.
    """
    drawn = Placements.join([Placements.originals(np.arange(len(footprints))), placements]).sorted()
    first = np.searchsorted(drawn.of, np.arange(len(footprints)))
    slot = np.arange(len(drawn)) - first[drawn.of]
    count = np.bincount(drawn.of, minlength=len(footprints))
    element, tables = _heights(borders, places, footprints, drawn, slot)
    kept, error = np.ones(len(drawn), np.bool_), np.zeros(len(footprints))
    for images in np.unique(count):
        rows = np.flatnonzero(count[element] == images)
        some = [tuple(side[rows, :images] for side in sides) for sides in tables]
        chosen, left = _least(element[rows], some, len(footprints), int(images))
        mine = np.flatnonzero(count == images)
        error[mine] = left[mine]
        for image in range(int(images)):
            kept[first[mine] + image] = chosen[mine, image]
    return np.flatnonzero(kept[drawn.side != NONE]), error


def _heights(
    borders: Borders,
    places: BorderPlaces,
    footprints: Footprints,
    drawn: Placements,
    slot: IntArray,
) -> tuple[IntArray, list[tuple[FloatArray, FloatArray]]]:
    """(K,) elements, each with a place of a seam, and for each of _SIZES, straight and bent, on
    either side (K, I) heights there of its images, by slot."""
    item, place = places.reached(footprints, drawn, drawn.charts(footprints, borders))
    seam = ~places.open[place]
    item, place = item[seam], place[seam]
    there = drawn.back(item, places.here[place])
    looks = [footprints.straight(), footprints] if footprints.slopes.any() else [footprints]
    near = np.stack([look.distance(drawn.of[item], there) for look in looks])
    close = near.min(axis=0) < _SIZES[-1]
    item, place, near = item[close], place[close], near[:, close]
    low = np.minimum(place, places.mate[place])
    key, row = np.unique(drawn.of[item] * len(places) + low, return_inverse=True)
    most, side = int(slot.max(initial=0)) + 1, (place != low).astype(np.int64)
    at = (side * len(key) + row.ravel()) * most + slot[item]
    tables = []
    for size, look in product(_SIZES, near):
        table = np.zeros((2, len(key), most))
        # Of an image that is at one place twice, which none is, either would do.
        table.reshape(-1)[at] = np.maximum(1.0 - (look / size) ** 2, 0.0) ** 2 / size**2
        tables.append((table[0], table[1]))
    return key // len(places), tables


def _least(
    element: IntArray, tables: list[tuple[FloatArray, ...]], count: int, images: int
) -> tuple[BoolArray, FloatArray]:
    """(E, I) the images with which both sides differ least, (E,) by how much; all of them unless
    others are clearly better. Where images meet the highest counts."""
    best = np.ones((count, images), np.bool_)
    least = _apart(element, tables, best[0], count)
    limit = _CLEARLY_BETTER * least
    for code in range(2 ** (images - 1) - 1):
        cancellation.check()
        mask = np.array([True, *(code >> bit & 1 for bit in range(images - 1))], np.bool_)
        left = _apart(element, tables, mask, count)
        better = left < np.minimum(least, limit)
        least[better], best[better] = left[better], mask
    return best, least


def _apart(
    element: IntArray, tables: list[tuple[FloatArray, ...]], mask: BoolArray, count: int
) -> FloatArray:
    """(E,) root of the sum of squares of how much both sides differ: the mean of straight and bent,
    so that other elements, which may bend, change nothing."""
    square = np.zeros(len(element))
    for here, there in tables:
        square += (here[:, mask].max(axis=1) - there[:, mask].max(axis=1)) ** 2
    square *= len(_SIZES) / len(tables)
    apart: FloatArray = np.sqrt(np.bincount(element, square, count))
    return apart
