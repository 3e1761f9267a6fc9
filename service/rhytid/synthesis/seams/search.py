"""Follows elements over UV seams, from chart to chart: how the UV of one chart go on in the next,
around a stretch of the seam between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.synthesis.seams.border_places import BorderPlaces
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.footprints import Footprints, Placements
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
# How much longer than wide a copy may be on the surface.
LONGER = 3.0
# How much the shape of a seam counts beside how its two triangles lie, across the seam.
_STIFFNESS = 0.02
# The most by which the shape of a seam may change lengths against its two triangles.
_BEND = 2.0


class Search:
    """Finds placements of elements, one after the other.  borders, places: those of the mesh."""

    def __init__(self, borders: Borders, places: BorderPlaces) -> None:
        self._borders, self._places = borders, places

    def placements(self, footprints: Footprints, counts: float) -> Placements:
        """All placements that elements need in other charts, in the order of the elements.

        counts: see `over_seams`.
        """
        drawn = Placements.originals(np.arange(len(footprints)))
        pairs = self._open_pairs(footprints, drawn, 0)
        for _ in range(_MOST - 1):
            more = self._next_placements(footprints, drawn, pairs, counts)
            if not len(more):
                break
            first, drawn = len(drawn), Placements.join([drawn, more])
            pairs = self._still_open(footprints, drawn, first, pairs)
        placements = drawn.take(np.flatnonzero(drawn.side != NONE)).sorted()
        return placements.take(self._in_their_charts(footprints, placements))

    def _next_placements(
        self, footprints: Footprints, drawn: Placements, pairs: _Pairs, counts: float
    ) -> Placements:
        """One more placement of each element that reaches over a seam where it is not yet drawn:
        over the seam that is nearest to one of its placements.  pairs: see `_open_pairs`."""
        more = over_seams(self._borders, self._places, footprints, drawn, pairs, counts)
        more = more.take(self._not_yet_drawn(footprints, drawn, more))
        return more.take(self._still_round(footprints, more))

    def _open_pairs(self, footprints: Footprints, drawn: Placements, first: int) -> _Pairs:
        """Rows (P,) of `drawn` from `first` on, places (P,) of seams that these reach and across
        which the element is not drawn as it should be, and (P,) how far away the places are."""
        asking = np.arange(first, len(drawn))
        item, place, near = self.within(footprints, drawn.take(asking))
        item = asking[item]
        further = np.where(drawn.nearest[item] < 1.0, _AGAIN, 0.0)
        widest = footprints.widest[drawn.of[item]]
        reached = near < np.where(drawn.side[item] == NONE, widest, further)
        pairs = item[reached], place[reached], near[reached]
        return _some(pairs, ~self._covered(footprints, drawn, np.arange(len(drawn)), pairs))

    def _still_open(
        self, footprints: Footprints, drawn: Placements, first: int, before: _Pairs
    ) -> _Pairs:
        """`_open_pairs` of all placements of those elements that have one from row `first` on.

        before: the pairs of the placements before `first`. A pair that is covered stays so: these
        pairs are compared with the new placements alone, and the places that the new placements
        reach with all.
        """
        new = np.arange(first, len(drawn))
        pairs = _some(before, np.isin(drawn.of[before[0]], drawn.of[new]))
        pairs = _some(pairs, ~self._covered(footprints, drawn, new, pairs))
        found = self._open_pairs(footprints, drawn, first)
        item, place, near = (np.concatenate(both) for both in zip(pairs, found, strict=True))
        return item, place, near

    def within(self, footprints: Footprints, drawn: Placements) -> _Pairs:
        """Rows (P,) of `drawn`, places (P,) on seams of their charts that these may reach, and (P,)
        how far away the places are, in sizes."""
        charts = drawn.charts(footprints, self._borders)
        item, place = self._places.reached(footprints, drawn, charts)
        seam = ~self._places.open[place]
        item, place = item[seam], place[seam]
        near = footprints.distance(drawn.of[item], drawn.back(item, self._places.here[place]))
        return item, place, near

    def _still_round(self, footprints: Footprints, more: Placements) -> IntArray:
        """Rows of the placements that are about as round on the surface across the seam as in their
        own chart. Where charts are crumpled within the size of an element, a placement would reach
        far along them."""
        flat = self._borders.beyond[more.side] @ more.turn @ np.linalg.inv(footprints.root[more.of])
        sizes = np.linalg.svd(flat, compute_uv=False)
        return np.flatnonzero(sizes[:, 0] < LONGER * sizes[:, 1])

    def _not_yet_drawn(
        self, footprints: Footprints, drawn: Placements, more: Placements
    ) -> IntArray:
        """Rows of the placements that are needed at the neutral size of the element, or lie apart
        from where the same element is drawn already in the same chart."""
        beside = np.zeros(len(more), np.bool_)
        chart, own = (placements.charts(footprints, self._borders) for placements in (drawn, more))
        middle = more.at(footprints.middle()[more.of])
        for rows, other in _others(drawn, more.of):
            asked = (more.nearest[rows] >= 1.0) & (chart[other] == own[rows])
            rows, other = rows[asked], other[asked]
            away = footprints.distance(more.of[rows], drawn.back(other, middle[rows]))
            beside[rows] |= away < 1.0 + _BESIDE * more.nearest[rows]
        return np.flatnonzero(~beside)

    def _covered(
        self, footprints: Footprints, drawn: Placements, by: IntArray, pairs: _Pairs
    ) -> BoolArray:
        """(P,) whether the element of each pair is already drawn across the seam as it should be,
        by one of the rows `by` of `drawn`."""
        item, place, near = pairs
        covered = np.zeros(len(item), np.bool_)
        for rows, other in _others(drawn.take(by), drawn.of[item]):
            cancellation.check()
            rows, other = rows[~covered[rows]], by[other[~covered[rows]]]
            there = drawn.back(other, self._places.there[place[rows]])
            gap = np.abs(footprints.distance(drawn.of[other], there) - near[rows])
            covered[rows] = gap <= _ABOUT + _SHARE * near[rows]
        return covered

    def _in_their_charts(self, footprints: Footprints, placements: Placements) -> IntArray:
        """Rows of the placements, without each that would be seen in a foreign chart before it
        reaches its own, or that lies among more borders than are looked at."""
        far = np.flatnonzero(placements.nearest >= 1.0)
        asked = placements.take(far)
        # No farther than their own seams.
        widest = np.zeros(len(footprints))
        np.maximum.at(widest, asked.of, _ROUNDED * asked.nearest)
        close = replace(footprints, widest=widest)
        item, place = self._places.reached(close, asked)
        charts = asked.charts(footprints, self._borders)
        foreign = self._places.chart[place] != charts[item]
        near = footprints.distance(asked.of[item], asked.back(item, self._places.here[place]))
        stray = near < np.where(foreign, 1.0, _NEARER) * asked.nearest[item]
        crowded = self._places.crowded(close, asked)
        stray = np.union1d(far[item[stray]], far[crowded])
        return np.setdiff1d(np.arange(len(placements)), stray)


def _some(pairs: _Pairs, kept: BoolArray) -> _Pairs:
    """The pairs of a mask, in their order."""
    item, place, near = pairs
    return item[kept], place[kept], near[kept]


def _others(drawn: Placements, of: IntArray) -> list[tuple[IntArray, IntArray]]:
    """For the first, second, ... of `drawn` of each element: the rows of `of` (N,) whose element
    has so many, and which of `drawn` that is."""
    order = np.argsort(drawn.of, kind="stable")
    first = np.searchsorted(drawn.of[order], of)
    count = np.searchsorted(drawn.of[order], of, "right") - first
    turns = range(int(count.max(initial=0)))
    rows = (np.flatnonzero(turn < count) for turn in turns)
    return [(some, order[first[some] + turn]) for turn, some in zip(turns, rows, strict=True)]


def over_seams(
    borders: Borders,
    places: BorderPlaces,
    footprints: Footprints,
    drawn: Placements,
    pairs: tuple[IntArray, IntArray, FloatArray],
    counts: float,
) -> Placements:
    """A placement of each element over the stretch of seam that is nearest to it.

    pairs: rows (P,) of `drawn`, places (P,) that they reach, and (P,) how far away these are, in
    sizes.  counts: the map from chart to chart is fitted to places up to so much farther away than
    the nearest.
    """
    item, place, near = pairs
    if not len(item):
        return Placements.originals(item)
    run = places.runs(item, place)
    # The nearest place of all of an element tells its run.
    order = np.lexsort((near, drawn.of[item]))
    best = order[np.append(True, np.diff(drawn.of[item][order]) != 0)]
    kept = np.flatnonzero(np.isin(run, run[best]))
    _, group = np.unique(drawn.of[item[kept]], return_inverse=True)
    group = group.ravel()
    source, row = drawn.take(item[best]), places.row[place[best]]
    root = footprints.root[source.of] @ np.linalg.inv(source.turn)
    weight = _weights(group, near[kept], len(best), counts)
    laid = _laid(borders, row, root), borders.beyond[row]
    here, there = places.here[place[kept]], places.there[place[kept]]
    nearest = places.here[place[best]], places.there[place[best]]
    turn, shift = _fitted(laid, group, weight, (here, there), nearest)
    return Placements(
        source.of,
        row,
        turn @ source.turn,
        np.einsum("nij,nj->ni", turn, source.shift) + shift,
        near[best],
    )


def _weights(group: IntArray, near: FloatArray, count: int, counts: float) -> FloatArray:
    """(P,) weights of places in a fit: the nearer the higher."""
    least = np.full(count, np.inf)
    np.minimum.at(least, group, near)
    beyond = np.minimum((near - least[group]) / counts, 1.0)
    weight: FloatArray = (1.0 - beyond**2) ** 4 + 1e-6
    return weight


def _fitted(
    laid: tuple[FloatArray, FloatArray],
    group: IntArray,
    weight: FloatArray,
    sides: tuple[FloatArray, FloatArray],
    nearest: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """(G, 2, 2), (G, 2): the affine maps that bring the places of each group best to where they
    are across the seam, and else as the two triangles lie.

    laid: (G, 2, 2) of both charts, to one plane.  sides: (P, 2) uv of places here and there.
    nearest: (G, 2) the same of one place of each group.
    """
    (flat, beyond), count = laid, len(laid[0])
    total = np.bincount(group, weight, count)[:, None]
    middle, other = (_sums(group, weight[:, None] * uv, count) / total for uv in sides)
    x = np.einsum("nij,nj->ni", flat[group], sides[0] - middle[group])
    y = np.einsum("nij,nj->ni", beyond[group], sides[1] - other[group])
    xx, yx = (
        _sums(group, weight[:, None, None] * a[:, :, None] * x[:, None], count) for a in (x, y)
    )
    pull = _STIFFNESS * np.trace(xx, axis1=1, axis2=2)[:, None, None] + 1e-30
    bend = (yx + pull * np.eye(2)) @ np.linalg.inv(xx + pull * np.eye(2))
    sizes = np.linalg.svd(bend, compute_uv=False)
    wild = (sizes[:, 0] > _BEND) | (sizes[:, 1] < 1 / _BEND) | (np.linalg.det(bend) <= 0)
    bend[wild] = np.eye(2)
    middle[wild], other[wild] = (uv[wild] for uv in nearest)
    turn = np.linalg.inv(beyond) @ bend @ flat
    return turn, other - np.einsum("nij,nj->ni", turn, middle)


def _laid(borders: Borders, row: IntArray, root: FloatArray) -> FloatArray:
    """(G, 2, 2) from the UV of a chart to the plane of both triangles at a side, as it is around
    the side; or, where charts are so crumpled that an element of root (G, 2, 2) would be longer
    than LONGER there, as the element is round and as large as it is on the seam."""
    sizes = np.linalg.svd(borders.flat[row] @ np.linalg.inv(root), compute_uv=False)
    crumpled = sizes[:, 0] > LONGER * sizes[:, 1]
    along = np.einsum("nij,nj->ni", root, borders.ends[row, 1] - borders.ends[row, 0])
    x, y = along.T
    size = np.hypot(x, y)
    turned = np.stack([x, y, -y, x], axis=-1).reshape(-1, 2, 2) / size[:, None, None] @ root
    sense = np.sign(np.linalg.det(borders.flat[row]) * np.linalg.det(turned))
    turned[:, 1] *= sense[:, None]
    round_: FloatArray = turned * (borders.length[row] / size)[:, None, None]
    return np.where(crumpled[:, None, None], round_, borders.flat[row])


def _sums(group: IntArray, values: NDArray[np.floating], count: int) -> FloatArray:
    """(G, ...) sums of values (P, ...) by group (P,)."""
    flat = values.reshape(len(values), -1)
    columns = [np.bincount(group, column, count).astype(np.float64) for column in flat.T]
    sums: FloatArray = np.stack(columns, axis=-1).reshape(count, *values.shape[1:])
    return sums
