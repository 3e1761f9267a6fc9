"""Lines that leaders may follow: traced from seeds where skin folds one way, along the preferred
directions, over the triangles and over UV seams.

How long each is to be, how large and how far from others, follows from hashes of its seed's place
and from how far skin has leaders there. Left and right differ, for their places in the map do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import SmoothNoise, level_directions
from rhytid.synthesis.hashes import Words, place_keys, unit_intervals
from rhytid.synthesis.leader_families import FAMILIES, RINGS, Family
from rhytid.synthesis.painted_fields import normals_at
from rhytid.synthesis.pore_density import SPACING
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.charts import side_at, trace
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface, joined

# Millimetres from one point of a line to the next.
STEP = 1.0
# Shares of its length at which the seed of a line lies.
_SEED_AT = (0.3, 0.7)
# How far skin must have leaders for a line to begin, and to go on.
_BEGINS, _GOES_ON = 0.12, 0.04
# Cosine of the turn in one step at which a line ends: it has run into a whirl of the field.
_WHIRL = 0.65
# The same of what the field itself turns over so many steps, without the winding: where it turns
# more, a line would end in a hook.
_HOOK, _HOOKED = 0.9, 3
# Seams that one step may cross.
_SEAMS = 3
# Purposes of random numbers.
_SEED, _NOISE, _SIZE = 0x51ED270B, 0x2545F491, 11


@dataclass(frozen=True, eq=False)
class Wishes:
    """What C lines are to be.

    key (C,): a random word of each.  size (C,): 0 to 1.  apart (C,): from larger lines, on the
    surface.  before, after (C,): steps to either side of the seed.  least (C,): steps that are left
    of it at least.  family (C,): its number.  broad, deep (C,): factors of how broad
    and how deep it is.
    """

    key: Words
    size: FloatArray
    apart: FloatArray
    before: IntArray
    after: IntArray
    least: IntArray
    family: IntArray
    broad: FloatArray
    deep: FloatArray

    @classmethod
    def of(
        cls, key: Words, leading: FloatArray, millimetre: float, seed: int, family: Family
    ) -> Wishes:
        """Wishes by chance.  leading (C,): how far skin has leaders."""
        one, two, three, four = (u.astype(np.float64) for u in unit_intervals(key, _SIZE, seed))
        size = np.sqrt(leading) * (family.least + (1.0 - family.least) * one**1.7)
        more = (family.longest - family.shortest) * size**0.25
        length = family.shortest + more * (0.55 + 0.45 * two)
        steps = np.minimum(length, family.longest) / STEP
        before = np.rint(steps * (_SEED_AT[0] + (_SEED_AT[1] - _SEED_AT[0]) * three))
        by_chance = family.chance[0] + family.chance[1] * four**2
        apart = (family.apart + family.farther * size) * by_chance * millimetre
        after = np.rint(steps) - before
        least, number = (
            np.full(len(key), value, np.int64)
            for value in (int(family.shortest / STEP), family.number)
        )
        before, after = before.astype(np.int64), after.astype(np.int64)
        broad, deep = np.full(len(key), family.broad), np.full(len(key), family.deep)
        return cls(key, size, apart, before, after, least, number, broad, deep)

    @property
    def order(self) -> IntArray:
        """The numbers of the lines: rings first, of each kind the largest."""
        found: IntArray = np.lexsort((self.key, -self.size, self.family != RINGS.number))
        return found


@dataclass(frozen=True, eq=False)
class Courses:
    """C lines of 2K + 1 points, K to either side of a seed, the point K; where a line ends before,
    the rest is not there.

    points: (C (2K + 1)), line after line.  way (C (2K + 1), 3): unit tangents at them, of either
    sign.  there (C, 2K + 1): which of them exist.  step (C, 2K,
    2): in UV from each point to the next, as it was walked, away from the seed.  length: on the
    surface, from point to point.
    """

    ground: Ground
    wishes: Wishes
    points: Points
    way: FloatArray
    there: BoolArray
    step: FloatArray
    length: float

    def index(self, row: IntArray | int, at: IntArray) -> IntArray:
        """The points with numbers `at` of the lines `row`."""
        found: IntArray = row * self.there.shape[1] + at
        return found

    @classmethod
    def traced(cls, ground: Ground, millimetre: float, seed: int) -> Courses:
        """Lines from seeds all over the skin that has leaders, family after family."""
        return cls.joined([cls.of(ground, millimetre, seed, family) for family in FAMILIES])

    @classmethod
    def joined(cls, parts: Sequence[Courses]) -> Courses:
        """The lines of all, part after part."""
        most = max(part.half for part in parts)
        parts = [part.padded(most) for part in parts]
        one, way = parts[0], np.concatenate([part.way for part in parts])
        there, step = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("there", "step")
        )
        wishes = joined([part.wishes for part in parts])
        points = joined([part.points for part in parts])
        return cls(one.ground, wishes, points, way, there, step, one.length)

    @property
    def half(self) -> int:
        """K."""
        return int(self.there.shape[1] // 2)

    def padded(self, half: int) -> Courses:
        """The same lines with `half` points to either side of the seed, at least K."""
        more, width = half - self.half, self.there.shape[1]
        at = np.clip(np.arange(2 * half + 1) - more, 0, width - 1)
        index = (np.arange(len(self.there))[:, None] * width + at).reshape(-1)
        there = np.pad(self.there, ((0, 0), (more, more)))
        step = np.pad(self.step, ((0, 0), (more, more), (0, 0)))
        points, way = self.points.take(index), self.way[index]
        return Courses(self.ground, self.wishes, points, way, there, step, self.length)

    @classmethod
    def of(cls, ground: Ground, millimetre: float, seed: int, family: Family) -> Courses:
        """Lines of one family."""
        seeds, leading = _seeds(ground, millimetre, seed, family)
        wishes = Wishes.of(place_keys(seeds.uv), leading, millimetre, seed ^ family.number, family)
        tracer = _Tracer(ground, millimetre, seed, family)
        back = tracer.traced(seeds, -1.0, wishes.before)
        ahead = tracer.traced(seeds, 1.0, wishes.after)
        triangle, uv, there = (
            np.concatenate([one[:, :0:-1], two], axis=1)
            for one, two in zip(back[:3], ahead[:3], strict=True)
        )
        step = np.concatenate([back[3][:, ::-1], ahead[3]], axis=1)
        triangle, uv = triangle.reshape(-1), uv.reshape(-1, 2)
        points, way = points_at(ground, triangle, uv), tracer.axes(triangle, uv)[0]
        return cls(ground, wishes, points, way, there, step, STEP * millimetre)

    def between(self, row: IntArray, at: FloatArray) -> Points:
        """Points of lines `row` (Q,) at `at` (Q,), counted in points."""
        half = self.half
        before = np.clip(np.floor(at).astype(np.int64), 0, 2 * half - 1)
        share, ahead = at - before, before >= half
        start = self.index(row, np.where(ahead, before, before + 1))
        share = np.where(ahead, share, 1.0 - share)
        triangle, uv, _ = _walked(
            self.ground, self.points.triangle[start], self.points.uv[start].astype(np.float64),
            self.step[row, before] * share[:, None],
        )  # fmt: skip
        return points_at(self.ground, triangle, uv)


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


def _seeds(
    ground: Ground, millimetre: float, seed: int, family: Family
) -> tuple[Points, FloatArray]:
    """Seeds evenly over the surface, of these the ones where skin has leaders, and how far."""
    radius, seed = family.seeds * millimetre / SPACING, seed ^ _SEED ^ family.number
    found = scatter_pores(ground.work, ground.surface, radius, seed, silent)
    leading = family.leading(ground.fields, found.triangle, found.uv)
    begins = leading >= _BEGINS
    return found.take(begins), leading[begins].astype(np.float64)


class _Tracer:
    """The directions that leaders take, and steps along them."""

    def __init__(self, ground: Ground, millimetre: float, seed: int, family: Family) -> None:
        self._ground, self._family, self._step_length = ground, family, STEP * millimetre
        rng = np.random.default_rng([seed, _NOISE])
        self._winding = [(bend, SmoothNoise(mm * millimetre, rng)) for bend, mm in family.winding]
        self._to_uv = np.linalg.pinv(ground.surface.jacobian)

    def traced(
        self, seeds: Points, side: float, steps: IntArray
    ) -> tuple[IntArray, FloatArray, BoolArray, FloatArray]:
        """(C, K + 1) triangles, (C, K + 1, 2) uv, (C, K + 1) whether the line goes so far, and
        (C, K, 2) UV steps.

        side: 1 along the directions, -1 the other way.  steps (C,): at most.
        """
        count, most = len(seeds), int(self._family.longest * _SEED_AT[1] / STEP) + 1
        triangle = np.repeat(seeds.triangle.astype(np.int64)[:, None], most + 1, axis=1)
        uv = np.repeat(seeds.uv.astype(np.float64)[:, None], most + 1, axis=1)
        step, there = np.zeros((count, most, 2)), np.zeros((count, most + 1), np.bool_)
        there[:, 0] = True
        axis, field = self.axes(triangle[:, 0], uv[:, 0])
        going, heading = np.arange(count), side * axis
        # Of the last points, the first the farthest back.
        passed = np.repeat(field[None], _HOOKED, axis=0)
        for k in range(most):
            cancellation.check()
            further = steps[going] > k
            going, heading = going[further], heading[further]
            at, where = triangle[going, k], uv[going, k]
            axis, field = self.axes(at, where)
            straight = _along(axis, heading) >= _WHIRL
            straight &= _along(field, passed[0, going]) >= _HOOK
            heading = axis * np.where(np.einsum("nx,nx->n", axis, heading) < 0, -1.0, 1.0)[:, None]
            passed[:-1], passed[-1, going] = passed[1:].copy(), field
            step[going, k] = self._step(at, heading)
            to, place, arrived = _walked(self._ground, at, where, step[going, k])
            goes = arrived & straight & self._goes_on(to, place)
            going, heading = going[goes], heading[goes]
            triangle[going, k + 1], uv[going, k + 1] = to[goes], place[goes]
            there[going, k + 1] = True
        return triangle, uv, there, step

    def axes(self, triangle: IntArray, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
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

    def _step(self, triangle: IntArray, heading: FloatArray) -> FloatArray:
        step = np.einsum("ncx,nx->nc", self._to_uv[triangle], heading)
        along = np.linalg.norm(self._ground.surface.along(triangle, step), axis=-1)
        found: FloatArray = step * (self._step_length / np.maximum(along, 1e-12))[:, None]
        return found

    def _goes_on(self, triangle: IntArray, uv: FloatArray) -> BoolArray:
        ground, place = self._ground, uv.astype(np.float32)
        leads: BoolArray = self._family.leading(ground.fields, triangle, place) >= _GOES_ON
        return leads & ground.surface.carries[triangle] & ~ground.fields.bare(triangle, place)


def _turned(level: FloatArray, beside: FloatArray, angle: FloatArray) -> FloatArray:
    """(N, 3) `level` turned towards `beside` by angles (N,)."""
    found: FloatArray = np.cos(angle)[:, None] * level
    found += np.sin(angle)[:, None] * beside
    return found


def _along(one: FloatArray, two: FloatArray) -> FloatArray:
    """(N,) cosines of the angles between axes (N, 3)."""
    found: FloatArray = np.abs(np.einsum("nx,nx->n", one, two))
    return found
