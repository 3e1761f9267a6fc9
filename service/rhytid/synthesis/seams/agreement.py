"""Which copies of an element bring the two sides of a seam closest to each other."""

from __future__ import annotations

from itertools import product

import numpy as np

from rhytid.support import cancellation
from rhytid.synthesis.seams.border_places import BorderPlaces
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# Elements are looked at in so many times their neutral size; larger ones count less.
_SIZES = (1.0, 2.0, 4.0)
# Copies are left out where both sides then differ by less than this share of the error.
_BETTER = 0.8


def agreeing(
    borders: Borders, places: BorderPlaces, supports: Supports, twins: Twins
) -> tuple[IntArray, FloatArray]:
    """Rows of the twins that are worth being drawn, and (E,) by how much the two sides of seams
    differ then, in depths times the root of how many places.

    Where charts are crumpled a twin may be right at the seam that it comes over and wrong along the
    next: two sides agree better without it.  twins: in the order of the elements.
    """
    drawn = Twins.join([Twins.originals(np.arange(len(supports))), twins]).sorted()
    first = np.searchsorted(drawn.of, np.arange(len(supports)))
    slot = np.arange(len(drawn)) - first[drawn.of]
    count = np.bincount(drawn.of, minlength=len(supports))
    element, tables = _heights(borders, places, supports, drawn, slot)
    kept, error = np.ones(len(drawn), np.bool_), np.zeros(len(supports))
    for images in np.unique(count):
        rows = np.flatnonzero(count[element] == images)
        some = [tuple(side[rows, :images] for side in sides) for sides in tables]
        chosen, left = _least(element[rows], some, len(supports), int(images))
        mine = np.flatnonzero(count == images)
        error[mine] = left[mine]
        for image in range(int(images)):
            kept[first[mine] + image] = chosen[mine, image]
    return np.flatnonzero(kept[drawn.side != NONE]), error


def _heights(
    borders: Borders, places: BorderPlaces, supports: Supports, drawn: Twins, slot: IntArray
) -> tuple[IntArray, list[tuple[FloatArray, FloatArray]]]:
    """(K,) elements, each with a place of a seam, and for each of _SIZES, straight and bent, on
    either side (K, I) heights there of its images, by slot."""
    who, place = places.reached(supports, drawn, drawn.charts(supports, borders))
    seam = ~places.open[place]
    who, place = who[seam], place[seam]
    there = drawn.back(who, places.here[place])
    looks = [supports.straight(), supports] if supports.slopes.any() else [supports]
    near = np.stack([look.distance(drawn.of[who], there) for look in looks])
    close = near.min(axis=0) < _SIZES[-1]
    who, place, near = who[close], place[close], near[:, close]
    low = np.minimum(place, places.mate[place])
    key, row = np.unique(drawn.of[who] * len(places) + low, return_inverse=True)
    most, side = int(slot.max(initial=0)) + 1, (place != low).astype(np.int64)
    at = (side * len(key) + row.ravel()) * most + slot[who]
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
    limit = _BETTER * least
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
    """(E,) root of the sum of squares of how much both sides differ."""
    square = np.zeros(len(element))
    for here, there in tables:
        square += (here[:, mask].max(axis=1) - there[:, mask].max(axis=1)) ** 2
    apart: FloatArray = np.sqrt(np.bincount(element, square, count))
    return apart
