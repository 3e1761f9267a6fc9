"""Perioral lines, which age draws from the border of the lips over the skin around them.

No pore moves with age, so these lines cannot be laid before the pores as leaders are. Each follows
lines that are there already, from pore to pore the way that runs most nearly as it is to run, and
makes them deeper and broader.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import level_directions, looked_up
from rhytid.synthesis.hashes import Words, place_keys, unit_intervals
from rhytid.synthesis.lines import Lines
from rhytid.synthesis.shapes import WIDE
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, unit

Singles = NDArray[np.float32]
# Shares of a lip from which on a pore lies within it, and of the mouth around it; and how far skin
# has a fan from which on it has no perioral lines.
_WITHIN, _AROUND, _FANNED = 0.5, 0.25, 0.5
# Millimetres: how far from the lip lines begin; how far around a place the lip says which way is
# outwards.
_BEGIN, _SEEN = 1.3, 6.0
# Cosine to the vertical from which on lines begin above or below the lips: none at their corners,
# which fans leave.
_UPRIGHT = 0.6
# Millimetres from one to the next, at least and by chance more; below the lips as many times that.
_APART, _FARTHER, _BELOW = 1.3, 2.2, 1.7
# Millimetres that one is to be long, and by chance longer.
_SHORTEST, _LONGER = 7.0, 3.0
# How far outwards lines spread, and lean by chance.
_SPREAD, _LEAN = 0.35, 0.2
# How worn skin is when the first appear, and by chance later.
_ONSET, _LATER = 0.1, 0.5
# Weight of the smallest, of the largest 1; the half width of these, in that of strength 1.
_SMALL, _BROAD = 0.65, 1.4
# Shares of its length over which a line rises, from half, and from where on it fades.
_RISES, _FADES = 0.12, 0.45
# What of the weight of other lines is taken beside one, and how far from it, millimetres.
_QUIET, _BESIDE = 0.5, 2.2
# How much longer a way counts that runs across, or along faint lines.
_ACROSS, _FAINT = 12.0, 0.25
# A way is looked for within so much of its length around its middle; by how much longer than
# straight it may be: what winds farther is a worm, and no line of skin.
_ROOM, _WINDING = 0.65, 1.08
# It ends where it runs best, so far along its course, and as far beside it as this times that.
_LEAST, _MOST, _ASIDE = 0.7, 1.05, 0.35
# Where there is no way, the next is looked for so far from there, millimetres.
_MISSED = 0.3
# A purpose of random numbers.
_CHANCE = 31


@dataclass(frozen=True, eq=False)
class PerioralLines:
    """P parts of perioral lines: wrinkles that they follow.

    line (P,): which wrinkles.  share (P,): how far each is part of one, 0 to 1: by age, rank and
    along the line.  beside (V,): the factor of the weight of all other wrinkles.
    """

    line: IntArray
    share: FloatArray
    beside: Singles

    @classmethod
    def of(
        cls,
        ground: Ground,
        pores: Points,
        lines: Lines,
        weight: Singles,
        millimetre: float,
        worn: float,
        rank: float,
        seed: int,
    ) -> PerioralLines | None:
        """Those of skin so worn, 1 at 65; None where it has none.

        weight (W,): of the lines.  millimetre: in units of the surface.  rank: how far lines have
        ranks, 1 at most counts: so deep are those of 1, and so much softer what is beside them.
        """
        worn, rank = max(worn, 0.0), min(rank, 1.0)
        if worn * rank == 0.0:
            return None
        lip, uneven, fans = (
            looked_up(of, pores)
            for of in (ground.fields.creases, ground.fields.uneven, ground.fields.fans)
        )
        around = (uneven > _AROUND) & (lip < _WITHIN) & (fans < _FANNED)
        if not around.any() or not (lip >= _WITHIN).any():
            return None
        border = _Border.of(pores, around, pores.position[lip >= _WITHIN], millimetre, seed)
        ways = _Ways(pores, lines, weight, around)
        drawn = list(border.across(ways))
        share = [rank * part.grown(worn) * _profile(part.at) for part in drawn]
        line = np.concatenate([np.empty(0, np.int64), *(part.line for part in drawn)])
        found = np.concatenate([np.empty(0), *share])
        return cls(line, found, ways.beside(line, found, _BESIDE * millimetre, lines.whole))

    def drawn(
        self,
        lines: Lines,
        leads: BoolArray,
        sizes: tuple[Singles, ...],
        spacing: float,
    ) -> BoolArray:
        """Change lines (W,) in place: their weights, and their half widths on the surface and in
        UV; and which of them (W,) are parts of perioral lines, deeper than they were.

        leads (W,): which are parts of leaders.  spacing: of pores, on the surface.
        """
        weight, width, half_width = sizes
        share = np.zeros(lines.whole, np.float32)
        np.maximum.at(share, self.line, self.share.astype(np.float32))
        # Halves of a wrinkle that is cut at a seam are alike.
        of = np.append(np.arange(lines.whole), lines.copy_of[lines.whole :])
        share, quiet = share[of], self.beside[of]
        parts = share > weight
        weight *= np.where(leads | parts, np.float32(1.0), quiet)
        np.maximum(weight, share, out=weight)
        wide = np.float32(_BROAD * WIDE * spacing) * np.sqrt(share)
        broader = np.maximum(wide / width, np.float32(1.0))
        width *= broader
        half_width *= broader
        found: BoolArray = parts
        return found


@dataclass(frozen=True, eq=False)
class _Line:
    """One line: the wrinkles (P,) that it follows, how far along it each is, 0 to 1, and how large
    it is and how worn skin is when it appears, 0 to 1."""

    line: IntArray
    at: FloatArray
    size: float
    onset: float

    def grown(self, worn: float) -> float:
        """How deep it is where it is deepest."""
        return self.size * min(max((worn - self.onset) / (1.0 - self.onset), 0.0), 1.0)


@dataclass(frozen=True, eq=False)
class _Border:
    """B pores beside the lips.

    pore (B,).  place (B, 3).  key (B,), chance (4, B): a word and numbers from 0 to 1 of each.
    level, up (B, 3): unit tangents.  beside, above (B,): the way outwards from the lip along these,
    of length 1 at most.
    """

    pore: IntArray
    place: FloatArray
    key: Words
    chance: FloatArray
    level: FloatArray
    up: FloatArray
    beside: FloatArray
    above: FloatArray
    millimetre: float

    @classmethod
    def of(
        cls, pores: Points, around: BoolArray, lip: FloatArray, millimetre: float, seed: int
    ) -> _Border:
        """Of pores `around` (N,) those near pores of the lip, which are at `lip` (L, 3)."""
        tree, pore = scipy.spatial.cKDTree(lip), np.flatnonzero(around)
        near = tree.query(pores.position[pore], distance_upper_bound=_BEGIN * millimetre)[0]
        pore = pore[np.isfinite(near)]
        place, normal = pores.position[pore], pores.normal[pore].astype(np.float64)
        level, key = level_directions(normal), place_keys(pores.uv[pore])
        up = np.cross(normal, level)
        seen = tree.query_ball_point(place, _SEEN * millimetre, return_sorted=True)
        centre = np.array([lip[of].mean(axis=0) for of in seen]).reshape(-1, 3)
        outwards = unit(place - centre)
        beside, above = ((outwards * axis).sum(axis=1) for axis in (level, up))
        chance = np.array(unit_intervals(key, _CHANCE, seed), np.float64)
        return cls(pore, place, key, chance, level, up, beside, above, millimetre)

    def across(self, ways: _Ways) -> Iterator[_Line]:
        """Lines up from the upper lip, and fewer down from the lower one."""
        tree, free = scipy.spatial.cKDTree(self.place), np.abs(self.above) > _UPRIGHT
        course = self._courses()
        for row in np.argsort(self.key, kind="stable").tolist():
            if not free[row]:
                continue
            cancellation.check()
            found = ways.along(self.pore[row], course[row])
            first, larger, _, later = self.chance[:, row].tolist()
            apart = _APART + _FARTHER * first if found else _MISSED
            apart *= _BELOW if self.above[row] < 0 else 1.0
            free[tree.query_ball_point(self.place[row], apart * self.millimetre)] = False
            if found:
                yield _Line(*found, _SMALL + (1.0 - _SMALL) * larger, _ONSET + _LATER * later)

    def _courses(self) -> FloatArray:
        """(B, 3) from each pore to where a line from there is to end: away from the lip."""
        _, long, lean, _ = self.chance
        aside = _SPREAD * self.beside + _LEAN * (2.0 * lean - 1.0)
        way = unit(np.sign(self.above)[:, None] * self.up + aside[:, None] * self.level)
        found: FloatArray = (_SHORTEST + _LONGER * long)[:, None] * self.millimetre * way
        return found


class _Ways:
    """Finds ways along lines that there are.

    lines: of a graph.  weight (W,): of these.  around (N,): pores that ways may go over.
    """

    def __init__(self, pores: Points, lines: Lines, weight: Singles, around: BoolArray) -> None:
        self._place, ends = pores.position, lines.pores[: lines.whole]
        self._line = np.flatnonzero(around[ends].all(axis=1))
        self._ends = ends[self._line]
        one, two = (self._place[self._ends[:, end]] for end in (0, 1))
        self._step, self._middle = two - one, 0.5 * (one + two)
        self._tree = scipy.spatial.cKDTree(self._middle)
        self._faint = _FAINT / (_FAINT + weight[self._line].astype(np.float64))

    def along(self, pore: int, course: FloatArray) -> tuple[IntArray, FloatArray] | None:
        """The lines on the way from a pore along a course (3,), and how far each is on it, 0 to 1;
        None where no way leads there that is nearly straight."""
        long, start = float(np.linalg.norm(course)), self._place[pore]
        near = self._tree.query_ball_point(start + 0.5 * course, _ROOM * long, return_sorted=True)
        rows = np.array(near, np.int64)
        pores, ends = np.unique(self._ends[rows], return_inverse=True)
        ends, first = ends.reshape(-1, 2), int(np.searchsorted(pores, pore))
        if first == len(pores) or pores[first] != pore:
            return None
        cost, before = self._costs(rows, ends, len(pores), first, course / long)
        last = _end(self._place[pores] - start, course, cost)
        if last is None:
            return None
        path = rows[_back(ends, before, last)]
        length = np.linalg.norm(self._step[path], axis=1)
        whole = float(length.sum())
        if whole > _WINDING * np.linalg.norm(self._place[pores[last]] - start):
            return None
        return self._line[path], (np.cumsum(length) - 0.5 * length) / whole

    def _costs(
        self, rows: IntArray, ends: IntArray, count: int, first: int, way: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """What ways from pore `first` of so many take at least to each, and the pore before it."""
        length = np.linalg.norm(self._step[rows], axis=1)
        across = 1.0 - (self._step[rows] @ way / length) ** 2
        cost = length * (1.0 + _ACROSS * across) * (1.0 + self._faint[rows])
        net = scipy.sparse.csr_array((cost, ends.T), shape=(count, count))
        found: tuple[FloatArray, IntArray] = scipy.sparse.csgraph.dijkstra(
            net, directed=False, indices=first, return_predecessors=True
        )
        return found

    def beside(self, line: IntArray, share: FloatArray, reach: float, count: int) -> Singles:
        """(V,) factors of the weights of V wrinkles beside `line` (P,)."""
        found = np.ones(count, np.float32)
        if not len(line):
            return found
        tree = scipy.spatial.cKDTree(self._middle[np.searchsorted(self._line, line)])
        distance, nearest = tree.query(self._middle, distance_upper_bound=reach)
        near = np.isfinite(distance)
        close = 1.0 - (distance[near] / reach) ** 2
        found[self._line[near]] = 1.0 - _QUIET * close * share[nearest[near]]
        return found


def _end(step: FloatArray, course: FloatArray, cost: FloatArray) -> int | None:
    """Which pore, at steps (M, 3) from the first, a way along a course (3,) ends at, by what ways
    to each take (M,): where it takes least for the square of how far it comes, so that it rather is
    long; None where none is in reach."""
    long = float(np.linalg.norm(course))
    far = step @ course / long
    aside = np.linalg.norm(step - far[:, None] * course / long, axis=1)
    reach = (far > _LEAST * long) & (far < _MOST * long) & (aside < _ASIDE * far)
    if not (reach & np.isfinite(cost)).any():
        return None
    return int(np.where(reach, cost / np.maximum(far, _LEAST * long) ** 2, np.inf).argmin())


def _back(ends: IntArray, before: IntArray, last: int) -> IntArray:
    """Numbers of the lines, which join pores `ends` (R, 2), on the way to pore `last`, from its
    beginning on.  before (M,): the pore before each."""
    number = {frozenset(pair): row for row, pair in enumerate(ends.tolist())}
    found = []
    while before[last] >= 0:
        found.append(number[frozenset((last, int(before[last])))])
        last = int(before[last])
    return np.array(found[::-1], np.int64)


def _profile(at: FloatArray) -> FloatArray:
    """How deep a line is so far along it, 0 to 1: soon as deep as it is, then less and less."""
    rise = 0.5 + 0.5 * np.clip(at / _RISES, 0.0, 1.0)
    fade = np.clip((1.0 - at) / (1.0 - _FADES), 0.0, 1.0)
    found: FloatArray = rise * fade * (2.0 - fade)
    return found
