"""What reaches over a UV seam, and where it lies in the charts across."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from rhytid.synthesis.borders import NONE, Borders
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

# Supports are followed to 4 times their neutral size, which is as wide as any response makes them,
# and a little further, for borders are looked at in places PLACES pore spacings apart.
WIDEST, PLACES = 4.25, 0.15
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
# How much longer than wide a copy may be on the surface.
_LONGER = 3.0
# It is not stored where it comes by so much nearer to another part of the border of its chart.
_NEARER = 0.7
# A map from chart to chart is fitted to places of a seam so much farther than the nearest.
_COUNTS = 2.0
# How much the shape of a seam counts beside how its two triangles lie, across the seam.
_STIFFNESS = 0.02
# The most by which the shape of a seam may change lengths against its two triangles.
_BEND = 2.0
_BLOCK = 1 << 15


@dataclass(frozen=True, eq=False)
class Shapes:
    """E elements as they are drawn: start (E, 2) and step (E, 2) in UV, step 0 for a pore; root
    (E, 2, 2): the rim is where |root·d| = 1; chart (E,)."""

    start: FloatArray
    step: FloatArray
    root: FloatArray
    chart: IntArray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, index: IntArray | BoolArray | slice) -> Shapes:
        """Those of an index or a mask, in its order."""
        return Shapes(*(getattr(self, field.name)[index] for field in fields(self)))

    def distance(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N,) from elements (N,) to places (N, 2), in units of their own neutral size."""
        root = self.root[index]
        gap = np.einsum("nij,nj->ni", root, uv - self.start[index])
        along = np.einsum("nij,nj->ni", root, self.step[index])
        length2 = (along * along).sum(-1)
        share = (gap * along).sum(-1) / np.where(length2 > 0, length2, 1.0)
        distance: FloatArray = np.linalg.norm(
            gap - np.clip(share, 0.0, 1.0)[:, None] * along, axis=-1
        )
        return distance

    def middle(self) -> FloatArray:
        """(E, 2) where they are centred."""
        middle: FloatArray = self.start + 0.5 * self.step
        return middle

    def reach(self) -> FloatArray:
        """(E,) how far from there they go in UV at their widest."""
        # Singular values in closed form: for every element of a graph a decomposition takes long.
        square, det = (self.root**2).sum(axis=(1, 2)), np.abs(np.linalg.det(self.root))
        largest2 = 0.5 * (square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0.0)))
        smallest = det / np.sqrt(largest2)
        reach: FloatArray = 0.5 * np.linalg.norm(self.step, axis=-1) + WIDEST / smallest
        return reach


@dataclass(frozen=True, eq=False)
class Twins:
    """T elements that are drawn in another chart, too.

    of (T,): the element.  side (T,): the row of the side of the seam that it comes over, on the
    chart that it comes from.  turn (T, 2, 2), shift (T, 2): from the UV of the element to those of
    the chart, uv -> turn·uv + shift.  nearest (T,): how far that seam is from it, in its own
    sizes.
    """

    of: IntArray
    side: IntArray
    turn: FloatArray
    shift: FloatArray
    nearest: FloatArray

    def __len__(self) -> int:
        return len(self.of)

    def take(self, index: IntArray | BoolArray) -> Twins:
        """Those of an index or a mask, in its order."""
        return Twins(*(getattr(self, field.name)[index] for field in fields(self)))

    def at(self, uv: FloatArray) -> FloatArray:
        """(T, 2) where a place (T, 2) of each element comes to lie."""
        there: FloatArray = np.einsum("nij,nj->ni", self.turn, uv) + self.shift
        return there

    @classmethod
    def join(cls, parts: list[Twins]) -> Twins:
        """All of them, one after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )

    @classmethod
    def originals(cls, of: IntArray) -> Twins:
        """The elements themselves."""
        count = len(of)
        none = np.full(count, NONE, np.int64)
        turn = np.tile(np.eye(2), (count, 1, 1))
        return cls(of, none, turn, np.zeros((count, 2)), np.zeros(count))


@dataclass(frozen=True, eq=False)
class _Places:
    """S places on the borders of charts. row (S,): of the side.  here, there (S, 2): uv on it and
    on its mate.  following (S,): the next place along the seam, or NONE."""

    row: IntArray
    here: FloatArray
    there: FloatArray
    following: IntArray

    @classmethod
    def on(cls, borders: Borders, apart: float) -> _Places:
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
        return cls(row, here, there, following)


class Seams:
    """The seams of a mesh, to ask what reaches over them.  apart: of places, on the surface."""

    def __init__(self, borders: Borders, apart: float) -> None:
        self._borders = borders
        places = _Places.on(borders, apart)
        self._places, self._tree = places, cKDTree(places.here)
        triangle = borders.triangle[places.row]
        mate = borders.mate[places.row]
        self._open = mate == NONE
        self._chart = borders.chart[triangle]

    def twins(self, shapes: Shapes) -> Twins:
        """What is to be drawn beside the elements, in the order of these."""
        if self._open.all() or not len(shapes):
            return Twins.originals(np.zeros(0, np.int64))
        distance, _ = self._tree.query(shapes.middle())
        near = np.flatnonzero(distance <= shapes.reach())
        found = [Twins.originals(near[:0])]
        for start in range(0, len(near), _BLOCK):
            some = near[start : start + _BLOCK]
            twins = self._of_block(shapes.take(some))
            found.append(Twins(some[twins.of], *list(vars(twins).values())[1:]))
        return Twins.join(found)

    def _of_block(self, shapes: Shapes) -> Twins:
        drawn = Twins.originals(np.arange(len(shapes)))
        active = np.arange(len(shapes))
        for _ in range(_MOST - 1):
            more = self._next(shapes, drawn, active)
            if not len(more):
                break
            active = more.of
            drawn = Twins.join([drawn, more])
        twins = drawn.take(np.flatnonzero(drawn.side != NONE))
        twins = twins.take(np.argsort(twins.of, kind="stable"))
        return twins.take(self._wanted(shapes, twins))

    def _next(self, shapes: Shapes, drawn: Twins, active: IntArray) -> Twins:
        """One more of each active element where it reaches over a seam and is not yet drawn: over
        the seam that is nearest to one of those drawn."""
        asking = np.flatnonzero(np.isin(drawn.of, active))
        who, place = self._pairs(shapes, drawn.take(asking))
        who = asking[who]
        seam = np.flatnonzero(
            ~self._open[place] & (self._chart[place] == self._charts(shapes, drawn)[who])
        )
        who, place = who[seam], place[seam]
        near = shapes.distance(drawn.of[who], _back(drawn, who, self._places.here[place]))
        further = np.where(drawn.nearest[who] < 1.0, _AGAIN, 0.0)
        reached = np.flatnonzero(near < np.where(drawn.side[who] == NONE, WIDEST, further))
        who, place, near = who[reached], place[reached], near[reached]
        missing = np.flatnonzero(~self._covered(shapes, drawn, who, place, near))
        who, place, near = who[missing], place[missing], near[missing]
        more = self._over(shapes, drawn, who, place, near)
        more = more.take(self._apart(shapes, drawn, more))
        return more.take(self._round(shapes, more))

    def _round(self, shapes: Shapes, more: Twins) -> IntArray:
        """Rows of what is about as round on the surface across the seam as it was. It is not where
        charts are crumpled within the size of an element: it would reach far along them."""
        flat = self._borders.beyond[more.side] @ more.turn @ np.linalg.inv(shapes.root[more.of])
        sizes = np.linalg.svd(flat, compute_uv=False)
        return np.flatnonzero(sizes[:, 0] < _LONGER * sizes[:, 1])

    def _apart(self, shapes: Shapes, drawn: Twins, more: Twins) -> IntArray:
        """Rows of what is not nearly where the same element is drawn already, in the same chart,
        or is needed at its neutral size."""
        order = np.argsort(drawn.of, kind="stable")
        first = np.searchsorted(drawn.of[order], more.of)
        count = np.searchsorted(drawn.of[order], more.of, "right") - first
        chart, beside = self._charts(shapes, drawn), np.zeros(len(more), np.bool_)
        own, middle = self._charts(shapes, more), more.at(shapes.middle()[more.of])
        for turn in range(int(count.max(initial=0))):
            rows = np.flatnonzero((turn < count) & (more.nearest >= 1.0))
            other = order[first[rows] + turn]
            rows, other = (a[chart[other] == own[rows]] for a in (rows, other))
            away = shapes.distance(more.of[rows], _back(drawn, other, middle[rows]))
            beside[rows] |= away < 1.0 + _BESIDE * more.nearest[rows]
        return np.flatnonzero(~beside)

    def _pairs(self, shapes: Shapes, drawn: Twins) -> tuple[IntArray, IntArray]:
        """(P,) of `drawn` and (P,) places on borders that each may reach."""
        own = shapes.take(drawn.of)
        largest = np.linalg.svd(drawn.turn, compute_uv=False)[:, 0]
        found = self._tree.query_ball_point(
            drawn.at(own.middle()), own.reach() * largest, return_sorted=True
        )
        counts = np.fromiter(map(len, found), np.int64, len(found))
        flat = np.fromiter(chain.from_iterable(found), np.int64, int(counts.sum()))
        return np.repeat(np.arange(len(found)), counts), flat

    def _charts(self, shapes: Shapes, drawn: Twins) -> IntArray:
        """(T,) the chart in which each is drawn."""
        mate = self._borders.triangle[self._borders.mate[drawn.side]]
        charts: IntArray = np.where(
            drawn.side == NONE, shapes.chart[drawn.of], self._borders.chart[mate]
        )
        return charts

    def _covered(
        self, shapes: Shapes, drawn: Twins, who: IntArray, place: IntArray, near: FloatArray
    ) -> BoolArray:
        """(P,) whether an element lies on the far side of a seam already as it should."""
        order = np.argsort(drawn.of, kind="stable")
        first = np.searchsorted(drawn.of[order], drawn.of[who])
        count = np.searchsorted(drawn.of[order], drawn.of[who], "right") - first
        covered = np.zeros(len(who), np.bool_)
        for turn in range(int(count.max(initial=0))):
            rows = np.flatnonzero((turn < count) & ~covered)
            other = order[first[rows] + turn]
            there = _back(drawn, other, self._places.there[place[rows]])
            gap = np.abs(shapes.distance(drawn.of[other], there) - near[rows])
            covered[rows] = gap <= _ABOUT + _SHARE * near[rows]
        return covered

    def _over(
        self, shapes: Shapes, drawn: Twins, who: IntArray, place: IntArray, near: FloatArray
    ) -> Twins:
        """A twin for the nearest stretch of seam of each element."""
        if not len(who):
            return Twins.originals(who)
        run = self._runs(who, place)
        # The nearest place of all of an element tells its run.
        order = np.lexsort((near, drawn.of[who]))
        best = order[np.append(True, np.diff(drawn.of[who][order]) != 0)]
        kept = np.flatnonzero(np.isin(run, run[best]))
        _, group = np.unique(drawn.of[who[kept]], return_inverse=True)
        source = drawn.take(who[best])
        root = shapes.root[source.of] @ np.linalg.inv(source.turn)
        turn, shift = self._fitted(root, group.ravel(), place[kept], near[kept], place[best])
        return Twins(
            source.of,
            self._places.row[place[best]],
            turn @ source.turn,
            np.einsum("nij,nj->ni", turn, source.shift) + shift,
            near[best],
        )

    def _runs(self, who: IntArray, place: IntArray) -> IntArray:
        """(P,) numbers of the stretches of seam that the pairs make up, of one element each."""
        size = len(self._places.row)
        key, following = who * size + place, self._places.following[place]
        order = np.argsort(key)
        wanted = who * size + following
        at = order[np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)]
        linked = np.flatnonzero((following != NONE) & (key[at] == wanted))
        links = coo_array(
            (np.ones(len(linked), np.int8), (linked, at[linked])), shape=(len(key), len(key))
        )
        run: IntArray = connected_components(links, directed=False)[1].astype(np.int64)
        return run

    def _fitted(
        self,
        root: FloatArray,
        group: IntArray,
        place: IntArray,
        near: FloatArray,
        nearest: IntArray,
    ) -> tuple[FloatArray, FloatArray]:
        """(G, 2, 2), (G, 2): the affine maps that bring the places of each group best to where they
        are across the seam, near ones above all, and else as the two triangles lie at `nearest`."""
        row = self._places.row[nearest]
        flat, beyond = self._laid(row, root), self._borders.beyond[row]
        count = len(nearest)
        least = np.full(count, np.inf)
        np.minimum.at(least, group, near)
        beyond_least = np.minimum((near - least[group]) / _COUNTS, 1.0)
        weight = (1.0 - beyond_least**2) ** 4 + 1e-6
        total = np.bincount(group, weight, count)[:, None]
        here, there = self._places.here[place], self._places.there[place]
        middle, other = (_sums(group, weight[:, None] * uv, count) / total for uv in (here, there))
        x = np.einsum("nij,nj->ni", flat[group], here - middle[group])
        y = np.einsum("nij,nj->ni", beyond[group], there - other[group])
        xx, yx = (
            _sums(group, weight[:, None, None] * a[:, :, None] * x[:, None], count) for a in (x, y)
        )
        pull = _STIFFNESS * np.trace(xx, axis1=1, axis2=2)[:, None, None] + 1e-30
        bend = (yx + pull * np.eye(2)) @ np.linalg.inv(xx + pull * np.eye(2))
        sizes = np.linalg.svd(bend, compute_uv=False)
        wild = (sizes[:, 0] > _BEND) | (sizes[:, 1] < 1 / _BEND) | (np.linalg.det(bend) <= 0)
        bend[wild] = np.eye(2)
        middle[wild], other[wild] = (
            self._places.here[nearest[wild]],
            self._places.there[nearest[wild]],
        )
        turn = np.linalg.inv(beyond) @ bend @ flat
        return turn, other - np.einsum("nij,nj->ni", turn, middle)

    def _laid(self, row: IntArray, root: FloatArray) -> FloatArray:
        """(G, 2, 2) from the UV of a chart to the plane of both triangles at a side, as it is
        around the side; or, where charts are so crumpled that an element of root (G, 2, 2) would be
        longer than _LONGER there, as the element is round and as large as it is on the seam."""
        borders = self._borders
        sizes = np.linalg.svd(borders.flat[row] @ np.linalg.inv(root), compute_uv=False)
        crumpled = sizes[:, 0] > _LONGER * sizes[:, 1]
        along = np.einsum("nij,nj->ni", root, borders.ends[row, 1] - borders.ends[row, 0])
        x, y = along.T
        size = np.hypot(x, y)
        turned = np.stack([x, y, -y, x], axis=-1).reshape(-1, 2, 2) / size[:, None, None] @ root
        sense = np.sign(np.linalg.det(borders.flat[row]) * np.linalg.det(turned))
        turned[:, 1] *= sense[:, None]
        round_: FloatArray = turned * (borders.length[row] / size)[:, None, None]
        return np.where(crumpled[:, None, None], round_, borders.flat[row])

    def _wanted(self, shapes: Shapes, twins: Twins) -> IntArray:
        """Rows of the twins without those that would be seen in a chart that they do not belong to
        before they reach their own."""
        far = np.flatnonzero(twins.nearest >= 1.0)
        asked = twins.take(far)
        who, place = self._pairs(shapes, asked)
        foreign = self._chart[place] != self._charts(shapes, asked)[who]
        near = shapes.distance(asked.of[who], _back(asked, who, self._places.here[place]))
        stray = near < np.where(foreign, 1.0, _NEARER) * asked.nearest[who]
        stray = np.unique(far[who[stray]])
        return np.setdiff1d(np.arange(len(twins)), stray)


def _back(twins: Twins, index: IntArray, uv: FloatArray) -> FloatArray:
    """(N, 2) what in the UV of an element lies at a place (N, 2) of the chart of its twin (N,)."""
    gap = uv - twins.shift[index]
    back = np.linalg.solve(twins.turn[index], gap[..., None])[..., 0]
    return back.astype(np.float64)


def _sums(group: IntArray, values: NDArray[np.floating], count: int) -> FloatArray:
    """(G, ...) sums of values (P, ...) by group (P,)."""
    flat = values.reshape(len(values), -1)
    columns = [np.bincount(group, column, count).astype(np.float64) for column in flat.T]
    sums: FloatArray = np.stack(columns, axis=-1).reshape(count, *values.shape[1:])
    return sums
