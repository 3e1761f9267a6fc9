"""Leaders: the few long deep lines of skin that folds one way, laid before pores are scattered.

Of the lines that were traced the largest come first; one that comes too near to an earlier one is
cut there. Pores then lie on them as on a string, so that their edges are smooth.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.lengths import SKIN, millimetres
from rhytid.support import cancellation
from rhytid.synthesis.candidate_graph import CandidateGraph, Ground
from rhytid.synthesis.hashes import unit_intervals
from rhytid.synthesis.leader_courses import Courses, starts
from rhytid.synthesis.leader_families import (
    CREASES,
    FAMILIES,
    FURROWS,
    RHOMBI,
    RINGS,
    Family,
    leading_of,
)
from rhytid.synthesis.pore_density import SPACING, spacings
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.seams.borders import NONE
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, unit

Singles = NDArray[np.float32]
# Of the distance that a larger line keeps from others, what it keeps from smaller ones at least.
_BESIDE = 0.75
# Cosine of the angle, 41 degrees, from which on lines cross and keep no distance.
_CROSSES = 0.75
# How much farther apart than they are lines count along one of them: ends may follow one another.
_ALONG = 2.2
# From one pore on a line to the next, in radii of its discs: some room for what the chord cuts off.
_PACE = 1.15
# Share of its length over which a line tapers to either end, and how broad the ends are.
_TAPER, _ENDS = 0.34, 0.5
# Families to which others come as near as the smaller of both distances.
_ALONE = (RINGS.number, CREASES.number, FURROWS.number)
# Families whose lines keep no distance from lines of others: they run on over rings.
_FREE = tuple(family.number for family in RHOMBI)
# Points of a chosen line around which others are looked for at a time.
_TOGETHER = 16
# Runs of true values in an array of them: of a few tens, searched as text they are found soonest.
_RUNS = re.compile(b"\x01+")
# Purposes of random numbers, the first of one for each wave.
_WAVY = 12


@dataclass(frozen=True, eq=False)
class LeaderPores:
    """Q pores on leaders, line after line, in order along each.

    line (Q,): the number of the leader.  depth (Q,) float32: how deep the leader is there, from 0
    at its ends to about 1 in the middle of the largest.  width (Q,) float32: how broad, likewise.
    profile (Q,) float32: the part of the depth that changes along the leader, about 1 in its
    middle.  family (Q,): the number of the family.  usual: the usual distance of pores, of that
    which these are laid for.
    """

    points: Points
    line: IntArray
    depth: NDArray[np.float32]
    width: NDArray[np.float32]
    profile: NDArray[np.float32]
    family: IntArray
    usual: float = 1.0

    def __len__(self) -> int:
        return len(self.line)

    @classmethod
    def none(cls) -> LeaderPores:
        """Those of skin without leaders."""
        nowhere = np.empty((0, 3), np.float32)
        points = Points(np.empty(0, np.int32), nowhere[:, :2], np.empty((0, 3)), nowhere)
        none, nothing = np.empty(0, np.int64), nowhere[:, 0]
        return cls(points, none, nothing, nothing, nothing, none)


def leaders_of(ground: Ground, spacing: float, settings: GraphSettings) -> Leaders | None:
    """The leaders of a ground; None where it has none, or settings ask for none.

    spacing: mean distance of pores on even skin, on the surface.
    """
    if settings.rank == 0 or not ground.fields.some_leading:
        return None
    scale = ground.surface.scale
    millimetre = unit_length(ground.unit, spacing * scale) / scale
    found = Leaders.of(ground, millimetre, settings.start)
    return found if len(found) else None


def unit_length(name: str | None, spacing: float) -> float:
    """A millimetre in the unit of `spacing`, the distance of pores; where the unit of the mesh is
    not known, by that distance. Where pores are farther apart than a millimetre, that."""
    known = None if name is None else millimetres(name)
    return max(spacing, spacing / SKIN.spacing if known is None else 1.0 / known)


@dataclass(frozen=True, eq=False)
class Leaders:
    """Traced lines that were chosen.

    row (L,): the course of each leader.  first, last (L,): the points of the course between which
    it runs.
    """

    courses: Courses
    row: IntArray
    first: IntArray
    last: IntArray
    seed: int

    def __len__(self) -> int:
        return len(self.row)

    @classmethod
    def of(cls, ground: Ground, millimetre: float, seed: int) -> Leaders:
        """Trace leaders on a ground.  millimetre: in units of the surface."""
        courses = Courses.traced(ground, millimetre, seed)
        return cls(courses, *_chosen(courses), seed)

    def pores(self, radius: float) -> LeaderPores:
        """Pores along the leaders, where others are at least `radius` apart."""
        surface, fields = self.courses.ground.surface, self.courses.ground.fields
        line, where = self._places(radius)
        row, wishes = self.row[line], self.courses.wishes
        points = self.courses.between(row, where)
        taper, ripple = self._profiles(line, where)
        profile = taper * ripple
        size = np.sqrt(wishes.size[row])
        width = size * wishes.broad[row] * (_ENDS + (1.0 - _ENDS) * taper) * np.sqrt(ripple)
        leading = leading_of(wishes.family[row], fields, points.triangle, points.uv)
        depth = size * wishes.deep[row] * profile * np.sqrt(np.clip(leading, 0.0, 1.0))
        holds = surface.carries[points.triangle] & ~fields.bare(points.triangle, points.uv)
        depth, width, profile = (v[holds].astype(np.float32) for v in (depth, width, profile))
        family = wishes.family[row[holds]]
        usual = SKIN.spacing * self.courses.millimetre / (SPACING * radius)
        points, line = points.take(holds), line[holds]
        return LeaderPores(points, line, depth, width, profile, family, usual)

    def _places(self, radius: float) -> tuple[IntArray, FloatArray]:
        """(Q,) the leader of each pore, and (Q,) where on it the pore lies, counted in points of
        its course."""
        count = self.last - self.first + 1
        line, start = np.repeat(np.arange(len(self)), count), starts(count)
        at = np.arange(len(line)) - (start[:-1] - self.first)[line]
        points = self.courses.points.take(self.courses.start[self.row[line]] + at)
        pace = _PACE * radius * spacings(self.courses.ground.fields, points.triangle, points.uv)
        wishes, row = self.courses.wishes, self.row[line]
        pace = np.minimum(pace, self.courses.millimetre * wishes.string[row])
        length = self.courses.millimetre * wishes.pace[row]
        parts = np.split(length / pace, start[1:-1])
        places = [_evenly(part, first) for part, first in zip(parts, self.first, strict=True)]
        of = np.repeat(np.arange(len(self)), [len(part) for part in places])
        return of, np.concatenate([np.empty(0), *places])

    def _profiles(self, line: IntArray, where: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(Q,) from 0 at the ends of leaders to 1 between, and (Q,) factors of their depth along
        them, as the families have these."""
        taper = _taper((where - self.first[line]) / (self.last - self.first)[line])
        row, ripple = self.row[line], np.ones(len(where))
        number = self.courses.wishes.family[row]
        for family in FAMILIES:
            of = np.flatnonzero(number == family.number)
            ripple[of] = self._ripple(family, row[of], where[of])
        return taper, ripple

    def _ripple(self, family: Family, row: IntArray, where: FloatArray) -> FloatArray:
        """(Q,) factors of the depth along lines of a family, about 1: waves with phases of each of
        their own.  row (Q,): the courses."""
        key, waves = self.courses.wishes.key[row], np.zeros(len(where))
        for salt, (least, more) in enumerate(family.waves, _WAVY):
            phase, longer = unit_intervals(key, salt, self.seed)[:2]
            waves += np.sin(2 * np.pi * (where * family.pace / (least + more * longer) + phase))
        ripple: FloatArray = np.maximum(1.0 + family.amplitude * waves, 0.0)
        return ripple


def _evenly(density: FloatArray, first: int) -> FloatArray:
    """Places along a line, counted in its points from `first` on, from end to end.  density (N,):
    places per step at each point, at most; none where it has no room for three."""
    sums = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1])))
    count = int(sums[-1])
    if count < 2:
        return np.empty(0)
    at = np.arange(first, first + len(density))
    places: FloatArray = np.interp(np.linspace(0.0, sums[-1], count + 1), sums, at)
    return places


def _taper(share: FloatArray) -> FloatArray:
    """From 0 at both ends of a line to 1 between, without a corner: it begins and ends level, for a
    steep end is seen as a cut."""
    rise = np.clip(np.minimum(share, 1.0 - share) / _TAPER, 0.0, 1.0)
    taper: FloatArray = rise * rise * (3.0 - 2.0 * rise)
    return taper


def _chosen(courses: Courses) -> tuple[IntArray, IntArray, IntArray]:
    """Lines that become leaders, and the first and the last point of each: one after the other,
    each where it is far enough from all before it."""
    free, start = np.ones(len(courses.points), np.bool_), courses.start.tolist()
    beside, every = _Beside(courses), courses.wishes.least.tolist()
    rows, spans = [], []
    for row in courses.wishes.order.tolist():
        own, least = free[start[row] : start[row + 1]], every[row]
        if np.count_nonzero(own) <= least:
            continue
        cancellation.check()
        first, last = _longest_run(own)
        if last - first < least:
            continue
        rows.append(row)
        spans.append((first, last))
        for at in range(start[row] + first, start[row] + last + 1, _TOGETHER):
            free[beside.of(row, slice(at, min(at + _TOGETHER, start[row] + last + 1)), free)] = (
                False
            )
    found = np.array(spans, np.int64).reshape(-1, 2)
    return np.array(rows, np.int64), found[:, 0], found[:, 1]


def _longest_run(free: BoolArray) -> tuple[int, int]:
    """The first and the last number of the longest run of free points; of none, a run that ends
    before it begins."""
    runs = _RUNS.finditer(free.tobytes())
    longest = max(runs, key=lambda run: run.end() - run.start(), default=None)
    return (0, -1) if longest is None else (longest.start(), longest.end() - 1)


class _Beside:
    """Finds the points of lines that are too near to a chosen one."""

    def __init__(self, courses: Courses) -> None:
        self._position, self._way = courses.points.position, courses.ways
        self._normal = courses.points.normal.astype(np.float64)
        line, wishes = courses.line, courses.wishes
        self._reach, self._family = wishes.apart, wishes.family
        self._kind = np.where(np.isin(wishes.family, _ALONE), wishes.family, NONE)
        self._of = wishes.family[line]
        self._apart, self._kinds = wishes.apart[line], self._kind[line]
        single = [family.number for family in FAMILIES if family.single]
        self._free = np.isin(wishes.family, _FREE)[line]
        self._cut = ~np.isin(wishes.family, single)[line]
        # A tree whose points are left one after the other is not worth balancing.
        quick = {"balanced_tree": False, "compact_nodes": False}
        self._tree = scipy.spatial.cKDTree(self._position, **quick)

    def of(self, row: int, points: slice, free: BoolArray) -> IntArray:
        """Numbers of the free points that lie too near to some that follow one another on a line,
        but those of lines that cross it where they may."""
        place, way, reach = self._position[points], self._way[points], self._reach[row]
        near = self._near(place, reach)
        near = near[free[near] & self._cut[near]]
        alike = self._kinds[near] == self._kind[row]
        limit = np.minimum(self._apart[near], reach)
        limit = np.where(alike, np.maximum(limit, _BESIDE * reach), limit)
        limit[self._free[near] & (self._of[near] != self._family[row])] = 0.0
        apart = self._position[near][:, None] - place
        along = np.einsum("mpx,px->mp", apart, way)
        distance = np.einsum("mpx,mpx->mp", apart, apart) + (_ALONG**2 - 1.0) * along**2
        one, two = np.nonzero(distance < (limit**2)[:, None])
        of, other = near[one], np.arange(points.start, points.stop)[two]
        facing = np.einsum("nx,nx->n", self._normal[of], self._normal[other]) > 0
        if FAMILIES[self._family[row]].crossed:
            cosine = np.abs(np.einsum("nx,nx->n", self._way[of], self._way[other]))
            facing &= cosine > _CROSSES
        taken: IntArray = of[facing]
        return taken

    def _near(self, line: FloatArray, reach: float) -> IntArray:
        """Numbers of the points in a cylinder around a line (P, 3), which has all within reach."""
        centre, chord = 0.5 * (line[0] + line[-1]), unit(line[-1:] - line[:1])[0]

        def beside(place: FloatArray) -> tuple[FloatArray, FloatArray]:
            apart = place - centre
            square = np.einsum("nx,nx->n", apart, apart)
            return square, square - np.einsum("nx,x->n", apart, chord) ** 2

        ball, cylinder = (float(np.sqrt(max(s.max(), 0.0))) + reach for s in beside(line))
        near = np.array(self._tree.query_ball_point(centre, ball, return_sorted=False), np.int64)
        found: IntArray = near[beside(self._position[near])[1] < cylinder**2]
        return found


class LeaderEdges(NamedTuple):
    """Edges of leaders: which they are (L,), the depth, the size, the profile, the number of the
    family and that of the leader of each."""

    edge: NDArray[np.intp]
    depth: Singles
    size: Singles
    profile: Singles
    family: NDArray[np.int64]
    leader: NDArray[np.int64]


def edges_along(net: CandidateGraph, leaders: LeaderPores) -> LeaderEdges:
    """The edges between pores that follow one another on a leader; where the net has none between
    two of them, those over the pore beside."""
    follows = np.flatnonzero(leaders.line[1:] == leaders.line[:-1])
    ends = np.sort(np.stack([net.first[follows], net.first[follows + 1]], axis=1), axis=1)
    at = _edges_between(net, ends)
    missing = np.flatnonzero(at < 0)
    # A gap would show as two blunt ends.
    beside, of = _ways_round(net, ends[missing])
    found = np.flatnonzero(at >= 0)
    edge, first = np.unique(np.concatenate([at[found], beside]), return_index=True)
    follows = follows[np.concatenate([found, missing[of]])[first]]
    depth, width, profile = (
        np.float32(0.5) * (values[follows] + values[follows + 1])
        for values in (leaders.depth, leaders.width, leaders.profile)
    )
    family, leader = leaders.family[follows], leaders.line[follows]
    return LeaderEdges(edge, depth, width, profile, family, leader)


def _edges_between(net: CandidateGraph, ends: NDArray[np.integer]) -> NDArray[np.intp]:
    """(P,) which edge joins each pair of pores (P, 2), the lower first; -1 where none does."""
    one, two = np.ascontiguousarray(net.edges.nodes[:, 0]), net.edges.nodes[:, 1]
    first, end = (np.searchsorted(one, ends[:, 0], side) for side in ("left", "right"))
    found = np.full(len(ends), -1)
    for way in range(int((end - first).max(initial=0))):
        at = np.minimum(first + way, len(one) - 1)
        found = np.where((first + way < end) & (two[at] == ends[:, 1]), at, found)
    return found


def _ways_round(
    net: CandidateGraph, ends: NDArray[np.integer]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(Q,) edges, two for each pair of pores (P, 2) that have a neighbour in common, over that by
    which the way is shortest; and (Q,) the pair."""
    asked, beside = np.zeros(len(net.pores), np.bool_), np.empty(len(net.edges.nodes), np.bool_)
    asked[ends] = True

    def look(rows: slice) -> None:
        one, two = net.edges.nodes[rows].T
        beside[rows] = asked[one] | asked[two]

    over_rows(len(beside), look)
    near = np.flatnonzero(beside)
    around: dict[int, dict[int, int]] = {}
    for edge, (one, two) in zip(near.tolist(), net.edges.nodes[near].tolist(), strict=True):
        around.setdefault(one, {})[two] = edge
        around.setdefault(two, {})[one] = edge
    place, edges, of = net.pores.position, [], []
    for pair, (one, two) in enumerate(ends.tolist()):
        over = np.array(sorted(around.get(one, {}).keys() & around.get(two, {}).keys()), np.int64)
        if len(over):
            legs = (np.linalg.norm(place[over] - place[end], axis=1) for end in (one, two))
            middle = int(over[np.argmin(sum(legs))])
            edges += [around[one][middle], around[two][middle]]
            of += [pair, pair]
    return np.array(edges, np.intp), np.array(of, np.intp)
