"""Lines that leaders may follow: traced from seeds where skin folds one way, along the preferred
directions, over the triangles and over UV seams.

How long each is to be, how large and how far from others, follows from hashes of its seed's place
and from how far skin has leaders there. Left and right differ, for their places in the map do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import Fields, SmoothNoise, level_directions
from rhytid.synthesis.hashes import Words, place_keys, unit_intervals
from rhytid.synthesis.leader_families import FAMILIES, FIRST, SEEDS, Family
from rhytid.synthesis.painting import normals_at
from rhytid.synthesis.pore_density import SPACING
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.charts import side_at, trace
from rhytid.synthesis.surface import (
    BoolArray,
    FloatArray,
    IntArray,
    Points,
    Surface,
    joined,
    taken,
    unit,
)

# Shares of its length at which the seed of a line lies.
_SEED_AT = (0.3, 0.7)
# How far skin must have leaders for a line to begin, and to go on.
_BEGINS, _GOES_ON = 0.12, 0.04
# Cosine of the turn in one step at which a line ends: it has run into a whirl of the field.
_WHIRL = 0.65
# The same of what the field itself turns over so many steps, without the winding: where it turns
# more, a line would end in a hook.
_HOOK, _HOOKED = 0.9, 2
# How far a line leans to where skin has leaders more by one, beside a step to the other side.
_LEAN = 0.6
# What the way so far weighs for such a line, and the tangent of the angle, 18 degrees, to which it
# keeps from its direction: it would wind, and a furrow between the brows does not.
_MEMORY, _HELD = 3.0, 0.325
# Seams that one step may cross.
_SEAMS = 3
# Purposes of random numbers.
_SEED, _NOISE, _SIZE, _THINNED = 0x51ED270B, 0x2545F491, 11, 15


@dataclass(frozen=True, eq=False)
class Wishes:
    """What C lines are to be.

    key (C,): a random word of each.  size (C,): 0 to 1.  apart (C,): from larger lines, on the
    surface.  before, after (C,): steps to either side of the seed.  least (C,): steps that are left
    of it at least.  family (C,): its number.  pace (C,): millimetres to a step.  broad, deep (C,):
    factors of how broad and how deep it is.  string (C,): the most millimetres between its pores.
    """

    key: Words
    size: FloatArray
    apart: FloatArray
    before: IntArray
    after: IntArray
    least: IntArray
    family: IntArray
    pace: FloatArray
    broad: FloatArray
    deep: FloatArray
    string: FloatArray

    @classmethod
    def of(
        cls, key: Words, leading: FloatArray, millimetre: float, seed: int, family: Family
    ) -> Wishes:
        """Wishes by chance.  leading (C,): how far skin has leaders."""
        one, two, three, four = (u.astype(np.float64) for u in unit_intervals(key, _SIZE, seed))
        size = np.sqrt(leading) * (family.least + (1.0 - family.least) * one**1.7)
        more = (family.longest - family.shortest) * size**0.25
        length = family.shortest + more * (0.55 + 0.45 * two)
        steps = np.minimum(length, family.longest) / family.pace
        before = np.rint(steps * (_SEED_AT[0] + (_SEED_AT[1] - _SEED_AT[0]) * three))
        by_chance = family.chance[0] + family.chance[1] * four**2
        apart = (family.apart + family.farther * size) * by_chance * millimetre
        after = np.rint(steps) - before
        least, number = (
            np.full(len(key), value, np.int64)
            for value in (int(np.ceil(family.shortest / family.pace)), family.number)
        )
        before, after = before.astype(np.int64), after.astype(np.int64)
        own = family.pace, family.broad, family.deep, family.string
        kind = (np.full(len(key), x) for x in own)
        return cls(key, size, apart, before, after, least, number, *kind)

    @property
    def order(self) -> IntArray:
        """The numbers of the lines: rings and those of a frown first, then furrows of the forehead,
        and of each of these and of the others the largest first."""
        turn = np.array([FIRST.get(family.number, 2) for family in FAMILIES])
        found: IntArray = np.lexsort((self.key, -self.size, turn[self.family]))
        return found


@dataclass(frozen=True, eq=False)
class Courses:
    """C lines, each of some points to either side of its seed.

    points (N,): line after line.  start (C + 1,): where each line begins among them, and N.  seed
    (C,): which of its points is the seed.  step (N, 2): in UV between each point and the next of
    its line, from the one that is nearer to the seed.  millimetre: on the surface.
    """

    ground: Ground
    wishes: Wishes
    points: Points
    start: IntArray
    seed: IntArray
    step: FloatArray
    millimetre: float

    @classmethod
    def traced(cls, ground: Ground, millimetre: float, seed: int) -> Courses:
        """Lines from seeds all over the skin that has leaders, family after family."""
        every, parts = _seeds(ground, SEEDS * millimetre, seed, Fields()), []
        for family in FAMILIES:
            seeds = every
            if family.seeds < SEEDS:
                where = _Where(ground.fields, family)
                seeds = _seeds(ground, family.seeds * millimetre, seed, where)
            tracer = _Tracer(ground, millimetre, seed, family)
            parts.append(tracer.courses(seeds, place_keys(seeds.uv)))
        return cls.joined(parts)

    @classmethod
    def joined(cls, parts: Sequence[Courses]) -> Courses:
        """The lines of all, part after part."""
        one, seed = parts[0], np.concatenate([part.seed for part in parts])
        count = np.concatenate([np.diff(part.start) for part in parts])
        step = np.concatenate([part.step for part in parts])
        wishes, points = (joined([getattr(p, n) for p in parts]) for n in ("wishes", "points"))
        return cls(one.ground, wishes, points, starts(count), seed, step, one.millimetre)

    @property
    def line(self) -> IntArray:
        """(N,) the line of each point."""
        return np.repeat(np.arange(len(self.seed)), np.diff(self.start))

    @property
    def ways(self) -> FloatArray:
        """(N, 3) unit tangents at the points."""
        line, at, place = self.line, np.arange(len(self.points)), self.points.position
        before, after = np.maximum(at - 1, self.start[line]), at + 1
        after = np.minimum(after, self.start[line + 1] - 1)
        return unit(place[after] - place[before])

    def between(self, row: IntArray, at: FloatArray) -> Points:
        """Points of lines `row` (Q,) at `at` (Q,), counted in points."""
        last = np.diff(self.start)[row] - 1
        before = np.clip(np.floor(at).astype(np.int64), 0, last - 1)
        share, ahead = at - before, before >= self.seed[row]
        start = self.start[row] + np.where(ahead, before, before + 1)
        share = np.where(ahead, share, 1.0 - share)
        triangle, uv, _ = _walked(
            self.ground, self.points.triangle[start], self.points.uv[start].astype(np.float64),
            self.step[self.start[row] + before] * share[:, None],
        )  # fmt: skip
        return points_at(self.ground, triangle, uv)


def starts(count: IntArray) -> IntArray:
    """(C + 1,) where parts of `count` (C,) rows each begin, one after the other, and the end."""
    found: IntArray = np.append(0, np.cumsum(count))
    return found


def points_at(ground: Ground, triangle: IntArray, uv: FloatArray) -> Points:
    """The points of a surface at uv (N, 2) in triangles (N,)."""
    normal = normals_at(ground.surface, triangle, uv).astype(np.float32)
    position = ground.surface.place(triangle, uv)
    return Points(triangle.astype(np.int32), uv.astype(np.float32), position, normal)


def _walked(
    ground: Ground, triangle: NDArray[np.integer], uv: FloatArray, step: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Go from uv (N, 2) in triangles (N,) by UV steps (N, 2), straight on over seams: the triangles
    (N,) and uv (N, 2) at the end, and (N,) whether the whole step was gone. It is not where the
    surface ends, or more than a few seams are in the way."""
    assert ground.borders is not None
    at: IntArray = triangle.astype(np.int64)
    arrived: BoolArray = np.zeros(len(uv), np.bool_)
    uv, going, left = uv.copy(), np.arange(len(uv)), step.copy()
    for _ in range(_SEAMS + 1):
        line = trace(ground.surface, ground.across, at[going], uv[going], left[going])
        at[going] = line.end
        uv[going] += line.share[:, None] * left[going]
        left[going] *= (1.0 - line.share)[:, None]
        arrived[going[line.share >= 1.0]] = True
        going = _over(ground.surface, ground.borders, at, uv, left, going[line.share < 1.0])
        if not len(going):
            break
    return at, uv, arrived


def _over(
    surface: Surface,
    borders: Borders,
    triangle: IntArray,
    uv: FloatArray,
    left: FloatArray,
    rows: IntArray,
) -> IntArray:
    """Take what stands at a seam to its other side, in place; those of `rows` that were taken."""
    row = borders.row[triangle[rows], side_at(surface.uv[triangle[rows]], uv[rows])]
    mate = np.where(row == NONE, NONE, borders.mate[row])
    rows, mate = rows[mate != NONE], mate[mate != NONE]
    uv[rows] = borders.from_mate(mate, uv[rows])
    left[rows] = np.einsum("nij,nj->ni", borders.turn_from_mate(mate), left[rows])
    triangle[rows] = borders.triangle[mate]
    return rows


def _seeds(ground: Ground, spacing: float, seed: int, fields: Fields) -> Points:
    """Seeds of lines, so far apart on the surface."""
    return scatter_pores(
        ground.work, ground.surface, spacing / SPACING, seed ^ _SEED, silent, fields
    )


class _Where(Fields):
    """Skin that is bare where it has no leaders of a family: seeds so dense are no use there."""

    some_bare = True

    def __init__(self, fields: Fields, family: Family) -> None:
        self._fields, self._family, self.detail = fields, family, fields.detail

    def bare(self, triangle: NDArray[Any], uv: NDArray[Any]) -> BoolArray:
        """Whether lines of the family cannot begin."""
        found: BoolArray = self._family.leading(self._fields, triangle, uv) < _BEGINS
        return found


class _Tracer:
    """Traces the lines of a family: the directions that they take, and steps along them."""

    def __init__(self, ground: Ground, millimetre: float, seed: int, family: Family) -> None:
        self._ground, self._family, self._millimetre = ground, family, millimetre
        self._seed = seed ^ family.number
        rng = np.random.default_rng([seed, _NOISE])
        self._winding = [(bend, SmoothNoise(mm * millimetre, rng)) for bend, mm in family.winding]

    def courses(self, seeds: Points, key: Words) -> Courses:
        """Lines from those of the seeds where skin has leaders, as far as they get long enough.

        key (N,): a random word of each seed.
        """
        leading = self._family.leading(self._ground.fields, seeds.triangle, seeds.uv)
        begins = np.flatnonzero((leading >= _BEGINS) & self._drawn(key))
        key, far = key[begins], leading[begins].astype(np.float64)
        wishes = Wishes.of(key, far, self._millimetre, self._seed, self._family)
        triangle, uv, step, gone = self._traced(seeds.take(begins), wishes)
        back, ahead = gone.reshape(2, -1)
        long = np.flatnonzero(back + ahead >= wishes.least)
        if self._family.single:
            has = self._leading_along(triangle, uv, gone)
            long = long[np.argsort(-has[long], kind="stable")[:1]]
        return self._joined(wishes, triangle, uv, step, gone, long)

    def _drawn(self, key: Words) -> BoolArray:
        """Of seeds, those that are seeds of this family."""
        share = min((SEEDS / self._family.seeds) ** 2, 1.0)
        return np.asarray(unit_intervals(key, _THINNED, self._seed)[0] < share)

    def _leading_along(self, triangle: IntArray, uv: FloatArray, gone: IntArray) -> FloatArray:
        """(C,) the sum of how far skin has leaders along lines, of both of their sides."""
        place = triangle.ravel(), uv.reshape(-1, 2).astype(np.float32)
        leading = self._family.leading(self._ground.fields, *place).reshape(triangle.shape)
        reached = np.arange(triangle.shape[1]) <= gone[:, None]
        found: FloatArray = (leading * reached).sum(axis=1).reshape(2, -1).sum(axis=0)
        return found

    def _joined(
        self,
        wishes: Wishes,
        triangle: IntArray,
        uv: FloatArray,
        step: FloatArray,
        gone: IntArray,
        long: IntArray,
    ) -> Courses:
        """Lines `long` (L,) from both of their sides."""
        back, ahead = gone.reshape(2, -1)
        count, seed = (back + ahead)[long] + 1, back[long]
        start, line = starts(count), np.repeat(np.arange(len(long)), count)
        at = np.arange(len(line)) - (start[:-1] + seed)[line]
        side = long[line] + np.where(at < 0, 0, len(back))
        nearer = np.where(at < 0, -at - 1, at)
        points = points_at(self._ground, triangle[side, np.abs(at)], uv[side, np.abs(at)])
        found, step = taken(wishes, long), step[side, nearer]
        return Courses(self._ground, found, points, start, seed, step, self._millimetre)

    def _traced(
        self, seeds: Points, wishes: Wishes
    ) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
        """(2C, K + 1) triangles, (2C, K + 1, 2) uv and UV steps from there, and (2C,) how many
        steps each goes: first all sides against the directions, then all along them."""
        steps = np.concatenate([wishes.before, wishes.after])
        count, most = len(steps), int(steps.max(initial=0))
        triangle = np.zeros((count, most + 1), np.int64)
        uv, step = np.zeros((2, count, most + 1, 2))
        triangle[:, 0], uv[:, 0] = np.tile(seeds.triangle, 2), np.tile(seeds.uv, (2, 1))
        gone, going = np.zeros(count, np.int64), np.arange(count)
        heading = passed = np.empty(0)
        for k in range(most):
            cancellation.check()
            further = steps[going] > k
            going, heading = going[further], heading[further] if k else heading
            at, where = triangle[going, k], uv[going, k]
            axis, field = self._axes(at, where)
            if k == 0:
                heading = axis * np.where(going < count // 2, -1.0, 1.0)[:, None]
                # Of the last points, the first the farthest back.
                passed = np.zeros((_HOOKED, count, 3))
                passed[:, going] = field
            straight = _along(axis, heading) >= _WHIRL
            straight &= _along(field, passed[0, going]) >= _HOOK
            before = heading
            heading = axis * np.where(np.einsum("nx,nx->n", axis, before) < 0, -1.0, 1.0)[:, None]
            if self._family.single:
                heading = self._kept(at, where, heading)
                heading = _straighter(heading, before, field)
            passed[:-1], passed[-1, going] = passed[1:].copy(), field
            step[going, k] = self._step(at, heading)
            to, place, arrived = _walked(self._ground, at, where, step[going, k])
            goes = arrived & straight & self._goes_on(to, place)
            going, heading = going[goes], heading[goes]
            triangle[going, k + 1], uv[going, k + 1] = to[goes], place[goes]
            gone[going] = k + 1
        return triangle, uv, step, gone

    def _axes(self, triangle: IntArray, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, 3) unit tangents along the lines that leaders follow, and those of the field about
        which these wind."""
        surface, fields = self._ground.surface, self._ground.fields
        normal, position = normals_at(surface, triangle, uv), surface.place(triangle, uv)
        level = level_directions(normal)
        beside = np.cross(normal, level)
        turn = self._family.turn(fields, triangle, uv.astype(np.float32))
        angle = turn.astype(np.float64)
        straight = _turned(level, beside, angle)
        for bend, noise in self._winding:
            angle += bend * noise.at(position)
        return _turned(level, beside, angle), straight

    def _kept(self, triangle: IntArray, uv: FloatArray, heading: FloatArray) -> FloatArray:
        """(N, 3) directions that lean to the side where skin has leaders more, so that a line keeps
        to its crest."""
        beside = np.cross(normals_at(self._ground.surface, triangle, uv), heading)
        step, fields = self._step(triangle, beside), self._ground.fields
        more, less = (
            self._family.leading(fields, triangle, place.astype(np.float32)).astype(np.float64)
            for place in (uv + step, uv - step)
        )
        return unit(heading + _LEAN * (more - less)[:, None] * beside)

    def _step(self, triangle: IntArray, heading: FloatArray) -> FloatArray:
        """(N, 2) UV steps of one pace along the triangles, as near to directions (N, 3) as these
        go."""
        u, v = np.moveaxis(self._ground.surface.jacobian[triangle], -1, 0)
        uu, uv, vv = (np.einsum("nx,nx->n", *pair) for pair in ((u, u), (u, v), (v, v)))
        a, b = (np.einsum("nx,nx->n", axis, heading) for axis in (u, v))
        # Least squares, but for a factor that the length takes out.
        step = np.stack([vv * a - uv * b, uu * b - uv * a], axis=-1)
        along = np.linalg.norm(self._ground.surface.along(triangle, step), axis=-1)
        pace = self._family.pace * self._millimetre
        found: FloatArray = step * (pace / np.maximum(along, 1e-300))[:, None]
        return found

    def _goes_on(self, triangle: IntArray, uv: FloatArray) -> BoolArray:
        ground, place = self._ground, uv.astype(np.float32)
        leads: BoolArray = self._family.leading(ground.fields, triangle, place) >= _GOES_ON
        return leads & ground.surface.carries[triangle] & ~ground.fields.bare(triangle, place)


def _straighter(heading: FloatArray, before: FloatArray, field: FloatArray) -> FloatArray:
    """(N, 3) headings that go on as those before did, and stay near the axes (N, 3) of a field."""
    heading = unit(heading + _MEMORY * before)
    along = np.einsum("nx,nx->n", heading, field)[:, None]
    beside = heading - along * field
    far = np.linalg.norm(beside, axis=1, keepdims=True) / np.maximum(_HELD * np.abs(along), 1e-30)
    return unit(along * field + beside / np.maximum(far, 1.0))


def _turned(level: FloatArray, beside: FloatArray, angle: FloatArray) -> FloatArray:
    """(N, 3) `level` turned towards `beside` by angles (N,)."""
    found: FloatArray = np.cos(angle)[:, None] * level
    found += np.sin(angle)[:, None] * beside
    return found


def _along(one: FloatArray, two: FloatArray) -> FloatArray:
    """(N,) cosines of the angles between axes (N, 3)."""
    found: FloatArray = np.abs(np.einsum("nx,nx->n", one, two))
    return found
