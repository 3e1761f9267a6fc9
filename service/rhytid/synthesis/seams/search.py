"""Follows elements over UV seams, from chart to chart: how the UV of one chart go on in the next,
around a stretch of the seam between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rhytid import stopping
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
    """Finds twins of elements, one after the other.  borders, places: those of the mesh."""

    def __init__(self, borders: Borders, places: BorderPlaces) -> None:
        self._borders, self._places = borders, places

    def twins(self, supports: Footprints, counts: float) -> Placements:
        """All that each needs, in the order of the elements.  counts: see `over_seams`."""
        drawn = Placements.originals(np.arange(len(supports)))
        pairs = self._open(supports, drawn, 0)
        for _ in range(_MOST - 1):
            more = self._next(supports, drawn, pairs, counts)
            if not len(more):
                break
            first, drawn = len(drawn), Placements.join([drawn, more])
            pairs = self._left(supports, drawn, first, pairs)
        twins = drawn.take(np.flatnonzero(drawn.side != NONE)).sorted()
        return twins.take(self._wanted(supports, twins))

    def _next(
        self, supports: Footprints, drawn: Placements, pairs: _Pairs, counts: float
    ) -> Placements:
        """One more of each element where it reaches over a seam and is not yet drawn: over the seam
        that is nearest to one of those drawn.  pairs: see `_open`."""
        more = over_seams(self._borders, self._places, supports, drawn, pairs, counts)
        more = more.take(self._apart(supports, drawn, more))
        return more.take(self._round(supports, more))

    def _open(self, supports: Footprints, drawn: Placements, first: int) -> _Pairs:
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

    def _left(self, supports: Footprints, drawn: Placements, first: int, before: _Pairs) -> _Pairs:
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

    def within(self, supports: Footprints, drawn: Placements) -> _Pairs:
        """(P,) of `drawn`, (P,) places on seams of their charts that these may reach, and (P,) how
        far away, in sizes."""
        charts = drawn.charts(supports, self._borders)
        who, place = self._places.reached(supports, drawn, charts)
        seam = ~self._places.open[place]
        who, place = who[seam], place[seam]
        near = supports.distance(drawn.of[who], drawn.back(who, self._places.here[place]))
        return who, place, near

    def _round(self, supports: Footprints, more: Placements) -> IntArray:
        """Rows of what is about as round on the surface across the seam as it was. It is not where
        charts are crumpled within the size of an element: it would reach far along them."""
        flat = self._borders.beyond[more.side] @ more.turn @ np.linalg.inv(supports.root[more.of])
        sizes = np.linalg.svd(flat, compute_uv=False)
        return np.flatnonzero(sizes[:, 0] < LONGER * sizes[:, 1])

    def _apart(self, supports: Footprints, drawn: Placements, more: Placements) -> IntArray:
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

    def _covered(
        self, supports: Footprints, drawn: Placements, by: IntArray, pairs: _Pairs
    ) -> BoolArray:
        """(P,) whether an element lies on the far side of a seam already as it should, as one of
        the rows `by` of those drawn."""
        who, place, near = pairs
        covered = np.zeros(len(who), np.bool_)
        for rows, other in _others(drawn.take(by), drawn.of[who]):
            stopping.check()
            rows, other = rows[~covered[rows]], by[other[~covered[rows]]]
            there = drawn.back(other, self._places.there[place[rows]])
            gap = np.abs(supports.distance(drawn.of[other], there) - near[rows])
            covered[rows] = gap <= _ABOUT + _SHARE * near[rows]
        return covered

    def _wanted(self, supports: Footprints, twins: Placements) -> IntArray:
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
    supports: Footprints,
    drawn: Placements,
    pairs: tuple[IntArray, IntArray, FloatArray],
    counts: float,
) -> Placements:
    """A twin over the nearest stretch of seam of each element.

    pairs: (P,) of `drawn`, (P,) places that they reach and (P,) how far away these are, in sizes.
    counts: a map from chart to chart is fitted to places so much farther than the nearest.
    """
    who, place, near = pairs
    if not len(who):
        return Placements.originals(who)
    run = places.runs(who, place)
    # The nearest place of all of an element tells its run.
    order = np.lexsort((near, drawn.of[who]))
    best = order[np.append(True, np.diff(drawn.of[who][order]) != 0)]
    kept = np.flatnonzero(np.isin(run, run[best]))
    _, group = np.unique(drawn.of[who[kept]], return_inverse=True)
    group = group.ravel()
    source, row = drawn.take(who[best]), places.row[place[best]]
    root = supports.root[source.of] @ np.linalg.inv(source.turn)
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
    """(P,) of places in a fit, near ones above all."""
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
