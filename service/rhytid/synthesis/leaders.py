"""Leaders: the few long deep lines of skin that folds one way, laid before pores are scattered.

Each is traced along the preferred directions from a seed, both ways, over the triangles and over UV
seams. Those of folds that are strong come first; one that comes too near to an earlier one is cut
there. Pores then lie on them as on a string, so that their edges are smooth. All of it depends on
hashes of places and on what is near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.lengths import SKIN, millimetres
from rhytid.support import cancellation
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import SmoothNoise, level_directions
from rhytid.synthesis.hashes import place_keys, unit_intervals
from rhytid.synthesis.painted_fields import normals_at
from rhytid.synthesis.pore_density import SPACING, spacings
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.seams.walks import walk
from rhytid.synthesis.surface import FloatArray, IntArray, Points, unit

# Millimetres: from seed to seed, and from one point of a line to the next.
SEEDS, STEP = 2.4, 0.8
# The shortest line that is kept, the longest, and how far one may reach to either side of its seed.
SHORTEST, LONGEST, _HALF = 7.0, 20.0, 16.0
# How far apart lines are: small ones, and how much farther the largest; of that of the larger line
# a small one beside it keeps this share.
_APART, _FARTHER, _BESIDE = 2.6, 3.4, 0.75
# How much farther apart than they are lines count along one of them: ends may follow one another.
_ALONG = 2.2
# How far lines wind about the preferred direction, radians, and over which lengths.
_WINDING = ((0.15, 9.0), (0.22, 2.2))
# Where less than this of what could lead is left, a line ends; seeds need more.
_FADED, _SEEDED = 0.04, 0.12
# Cosine of the turn in one step at which a line ends: it has run into a whirl of the field.
_WHIRL = 0.8
# From one pore on a line to the next, in those of the radius; a few per cent of room for what the
# chord cuts off.
_PACE = 1.15
# Purposes of random numbers.
_SEED, _NOISE, _SIZE, _UNEVEN = 0x51ED270B, 0x2545F491, 11, 12


@dataclass(frozen=True, eq=False)
class LeaderPores:
    """Q pores on leaders, line after line, in order along each.

    line (Q,): the number of the leader.  depth (Q,) float32: how deep the leader is there, from 0
    at its ends to 1 in the middle of the largest.  width (Q,) float32: how broad, likewise.
    """

    points: Points
    line: IntArray
    depth: NDArray[np.float32]
    width: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.line)


def unit_length(name: str | None, spacing: float) -> float:
    """A millimetre in the unit of `spacing`, the distance of pores; where the unit of the mesh is
    not known, by that distance. Where pores are farther apart than a millimetre, that."""
    known = None if name is None else millimetres(name)
    return max(spacing, spacing / SKIN.spacing if known is None else 1.0 / known)


def leaders_of(
    ground: Ground, spacing: float, settings: GraphSettings, progress: Progress = silent
) -> Leaders | NoLeaders:
    """The leaders of a ground, if its skin folds and settings ask for any.

    spacing: mean distance of pores on even skin, on the surface.
    """
    if settings.rank == 0 or not ground.fields.some_leading:
        return NoLeaders()
    scale = ground.surface.scale
    millimetre = unit_length(ground.unit, spacing * scale) / scale
    return Leaders.of(ground, millimetre, settings.start, progress)


class NoLeaders:
    """Skin without leaders."""

    def pores(self, radius: float) -> LeaderPores:
        """None."""
        nowhere = Points(
            np.empty(0, np.int32), np.empty((0, 2), np.float32), np.empty((0, 3)),
            np.empty((0, 3), np.float32),
        )  # fmt: skip
        none = np.empty(0, np.float32)
        return LeaderPores(nowhere, np.empty(0, np.int64), none, none)


@dataclass(frozen=True, eq=False)
class Leaders:
    """Traced lines that were chosen.

    row (L,): the line of each leader among the trails.  first, last (L,): the points between which
    it runs.  size (L,): 0 to 1.
    """

    ground: Ground
    trails: Trails
    row: IntArray
    first: IntArray
    last: IntArray
    size: NDArray[np.float32]
    seed: int

    def __len__(self) -> int:
        return len(self.row)

    @classmethod
    def of(
        cls,
        ground: Ground,
        millimetre: float,
        seed: int,
        progress: Progress = silent,
    ) -> Leaders:
        """Trace leaders on a ground.  millimetre: in units of the surface."""
        trails = Trails.traced(ground, millimetre, seed, progress)
        return cls(ground, trails, *_chosen(trails, millimetre, seed), seed)

    def pores(self, radius: float) -> LeaderPores:
        """Pores along the leaders, where others are at least `radius` apart."""
        surface, fields = self.ground.surface, self.ground.fields
        at = [self._places(i, radius) for i in range(len(self))]
        line = np.repeat(np.arange(len(self)), [len(places) for places in at])
        where = np.concatenate([np.empty(0), *at])
        points = self.trails.between(self.row[line], where)
        span = np.maximum(self.last - self.first, 1)[line]
        taper = _taper((where - self.first[line]) / span)
        uneven, size = self._uneven(line, where), np.sqrt(self.size[line])
        width, depth = size * (0.4 + 0.6 * taper) * np.sqrt(uneven), size * taper * uneven
        depth *= np.sqrt(np.clip(fields.leading(points.triangle, points.uv), 0.0, 1.0))
        holds = surface.carries[points.triangle] & ~fields.bare(points.triangle, points.uv)
        values = (values[holds].astype(np.float32) for values in (depth, width))
        return LeaderPores(points.take(holds), line[holds], *values)

    def _places(self, i: int, radius: float) -> FloatArray:
        """Where along its line the pores of leader `i` lie, counted in points of the trail."""
        at = np.arange(self.first[i], self.last[i] + 1)
        points = self.trails.points.take(self.trails.index(self.row[i], at))
        pace = _PACE * radius * spacings(self.ground.fields, points.triangle, points.uv)
        density = self.trails.length / pace
        sums = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1])))
        count = int(sums[-1])
        if count < 2:
            return np.empty(0)
        places: FloatArray = np.interp(np.linspace(0.0, sums[-1], count + 1), sums, at)
        return places

    def _uneven(self, line: IntArray, where: FloatArray) -> FloatArray:
        """(Q,) factors of the depth along each line, about 1: two waves with phases of its own."""
        one, two, three, _ = unit_intervals(self.trails.key[self.row[line]], _UNEVEN, self.seed)
        along = where * STEP
        waves = np.sin(2 * np.pi * (along / (2.2 + 2.5 * three) + one))
        waves += np.sin(2 * np.pi * (along / (7.0 + 6.0 * one) + two))
        found: FloatArray = 1.0 + 0.25 * waves
        return found


@dataclass(frozen=True, eq=False)
class Trails:
    """C lines of 2K + 1 points, K to either side of a seed, the point K; where a line ends before,
    the rest is not there.

    points: (C (2K + 1)), line after line.  there (C, 2K + 1): which of them exist.  step (C, 2K,
    2): in UV from each point to the next, as it was walked, away from the seed.  leading (C, 2K +
    1): how far skin has leaders at each point.  key (C,): a random word of each seed.  length: on
    the surface, from point to point.
    """

    ground: Ground
    points: Points
    there: NDArray[np.bool_]
    step: FloatArray
    leading: NDArray[np.float32]
    key: NDArray[np.uint32]
    length: float

    @property
    def half(self) -> int:
        """K."""
        return int(self.there.shape[1] // 2)

    def index(self, row: IntArray | int, at: IntArray) -> IntArray:
        """The points with numbers `at` of the lines `row`."""
        found: IntArray = row * self.there.shape[1] + at
        return found

    @classmethod
    def traced(cls, ground: Ground, millimetre: float, seed: int, progress: Progress) -> Trails:
        """Lines from seeds all over the skin that folds one way."""
        fields = ground.fields
        seeds = _seeds(ground, millimetre, seed, progress)
        course = _Course(ground, millimetre, seed)
        back, ahead = (course.traced(seeds, side, int(_HALF / STEP)) for side in (-1.0, 1.0))
        triangle, uv, there = (
            np.concatenate([one[:, :0:-1], two], axis=1)
            for one, two in zip(back[:3], ahead[:3], strict=True)
        )
        step = np.concatenate([back[3][:, ::-1], ahead[3]], axis=1)
        points = _points(ground, triangle.reshape(-1), uv.reshape(-1, 2))
        leading = fields.leading(points.triangle, points.uv).reshape(there.shape)
        key = place_keys(seeds.uv)
        return cls(ground, points, there, step, leading, key, STEP * millimetre)

    def between(self, row: IntArray, at: FloatArray) -> Points:
        """Points of lines `row` (Q,) at `at` (Q,), counted in points."""
        before = np.clip(np.floor(at).astype(np.int64), 0, 2 * self.half - 1)
        share, ahead = at - before, before >= self.half
        start = self.index(row, np.where(ahead, before, before + 1))
        share = np.where(ahead, share, 1.0 - share)
        triangle, uv, _ = _walked(
            self.ground, self.points.triangle[start], self.points.uv[start].astype(np.float64),
            self.step[row, before] * share[:, None],
        )  # fmt: skip
        return _points(self.ground, triangle, uv)


def _walked(
    ground: Ground, triangle: NDArray[np.integer], uv: FloatArray, step: FloatArray
) -> tuple[IntArray, FloatArray, NDArray[np.bool_]]:
    assert ground.borders is not None
    return walk(ground.surface, ground.across, ground.borders, triangle, uv, step)


def _points(ground: Ground, triangle: IntArray, uv: FloatArray) -> Points:
    surface = ground.surface
    normal = normals_at(surface, triangle, uv).astype(np.float32)
    position = surface.place(triangle, uv)
    return Points(triangle.astype(np.int32), uv.astype(np.float32), position, normal)


def _seeds(ground: Ground, millimetre: float, seed: int, progress: Progress) -> Points:
    """Seeds evenly over the surface, of these the ones where skin has leaders."""
    radius = SEEDS * millimetre / SPACING
    found = scatter_pores(ground.work, ground.surface, radius, seed ^ _SEED, progress)
    leading = ground.fields.leading(found.triangle, found.uv)
    return found.take(leading >= _SEEDED)


class _Course:
    """The directions that leaders take, and steps along them."""

    def __init__(self, ground: Ground, millimetre: float, seed: int) -> None:
        self._ground, self._millimetre = ground, millimetre
        rng = np.random.default_rng([seed, _NOISE])
        self._winding = [(bend, SmoothNoise(mm * millimetre, rng)) for bend, mm in _WINDING]
        self._to_uv = np.linalg.pinv(ground.surface.jacobian)

    def traced(
        self, seeds: Points, side: float, steps: int
    ) -> tuple[IntArray, FloatArray, NDArray[np.bool_], FloatArray]:
        """(C, K + 1) triangles, (C, K + 1, 2) uv, (C, K + 1) whether the line goes so far, and
        (C, K, 2) UV steps."""
        count = len(seeds)
        triangle = np.zeros((count, steps + 1), np.int64)
        uv, step = np.zeros((count, steps + 1, 2)), np.zeros((count, steps, 2))
        there = np.zeros((count, steps + 1), np.bool_)
        triangle[:, 0], uv[:, 0], there[:, 0] = seeds.triangle, seeds.uv, True
        going, heading = np.arange(count), side * self._axis(triangle[:, 0], uv[:, 0])
        for k in range(steps):
            cancellation.check()
            at, where = triangle[going, k], uv[going, k]
            heading, straight = self._turned(heading, at, where)
            step[going, k] = self._step(at, heading)
            to, place, arrived = _walked(self._ground, at, where, step[going, k])
            triangle[:, k + 1], uv[:, k + 1] = triangle[:, k], uv[:, k]
            goes = arrived & straight & self._leads(to, place)
            going, heading = going[goes], heading[goes]
            triangle[going, k + 1], uv[going, k + 1] = to[goes], place[goes]
            there[going, k + 1] = True
        return triangle, uv, there, step

    def _axis(self, triangle: IntArray, uv: FloatArray) -> FloatArray:
        """(N, 3) unit tangents along the lines that leaders follow."""
        surface, fields = self._ground.surface, self._ground.fields
        normal, position = normals_at(surface, triangle, uv), surface.place(triangle, uv)
        angle = fields.turn(triangle, uv.astype(np.float32)).astype(np.float64)
        for bend, noise in self._winding:
            angle += bend * noise.at(position)
        level = level_directions(normal)
        found: FloatArray = np.cos(angle)[:, None] * level
        found += np.sin(angle)[:, None] * np.cross(normal, level)
        return found

    def _turned(
        self, heading: FloatArray, triangle: IntArray, uv: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """(N, 3) headings along the field, and (N,) whether they turn little."""
        axis = self._axis(triangle, uv)
        cosine = np.einsum("nx,nx->n", axis, heading)
        return axis * np.where(cosine < 0, -1.0, 1.0)[:, None], np.abs(cosine) >= _WHIRL

    def _step(self, triangle: IntArray, heading: FloatArray) -> FloatArray:
        step = np.einsum("ncx,nx->nc", self._to_uv[triangle], heading)
        along = np.linalg.norm(self._ground.surface.along(triangle, step), axis=-1)
        found: FloatArray = step * (STEP * self._millimetre / np.maximum(along, 1e-12))[:, None]
        return found

    def _leads(self, triangle: IntArray, uv: FloatArray) -> NDArray[np.bool_]:
        ground, place = self._ground, uv.astype(np.float32)
        leads: NDArray[np.bool_] = ground.fields.leading(triangle, place) >= _FADED
        return leads & ground.surface.carries[triangle] & ~ground.fields.bare(triangle, place)


def _taper(share: FloatArray) -> FloatArray:
    """From 0 at both ends of a line to 1 in its middle half, without a corner."""
    rise = np.clip(np.minimum(share, 1.0 - share) / 0.25, 0.0, 1.0)
    taper: FloatArray = rise * (2.0 - rise)
    return taper


@dataclass(frozen=True, eq=False)
class _Wishes:
    """What C candidates would be, by chance and by how far skin has leaders at their seeds.

    order (C,): which comes first.  size (C,): 0 to 1.  apart (C,): from larger lines, on the
    surface.  first, last (C,): the points between which each would run.
    """

    order: IntArray
    size: FloatArray
    apart: FloatArray
    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, trails: Trails, millimetre: float, seed: int) -> _Wishes:
        one, two, three, four = unit_intervals(trails.key, _SIZE, seed)
        leading = trails.leading[:, trails.half].astype(np.float64)
        size = np.sqrt(leading) * (0.12 + 0.88 * one.astype(np.float64) ** 1.7)
        long = SHORTEST + (LONGEST - SHORTEST) * size**0.25 * (0.55 + 0.45 * two)
        points = np.minimum(long, LONGEST) / STEP
        before = points * (0.3 + 0.4 * three)
        first = np.maximum(np.rint(trails.half - before), 0).astype(np.int64)
        last = np.minimum(first + np.rint(points), 2 * trails.half).astype(np.int64)
        apart = (_APART + _FARTHER * size) * (0.65 + 0.9 * four**2) * millimetre
        order = np.lexsort((trails.key, -size))
        return cls(order, size, apart, first, last)


def _chosen(
    trails: Trails, millimetre: float, seed: int
) -> tuple[IntArray, IntArray, IntArray, NDArray[np.float32]]:
    """Candidates that become leaders, the first and the last point of each, and their sizes: one
    after the other, each where it is far enough from all before it."""
    wishes, width = _Wishes.of(trails, millimetre, seed), trails.there.shape[1]
    free, least = trails.there.copy(), int(SHORTEST / STEP)
    beside = _Beside(trails, wishes)
    rows, spans = [], []
    for i in wishes.order:
        span = _longest_run(free[i], wishes.first[i], wishes.last[i])
        if span[1] - span[0] < least:
            continue
        rows.append(i)
        spans.append(span)
        taken = beside.of(i, np.arange(span[0], span[1] + 1))
        free[taken // width, taken % width] = False
    found = np.array(spans, np.int64).reshape(-1, 2)
    chosen = np.array(rows, np.int64)
    return chosen, found[:, 0], found[:, 1], wishes.size[chosen].astype(np.float32)


def _longest_run(free: NDArray[np.bool_], first: int, last: int) -> tuple[int, int]:
    """The first and the last number of the longest run of free points in a range; of none, a run
    that ends before it begins."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free[first : last + 1], [False]])))
    if not len(edges):
        return 0, -1
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return first + int(starts[longest]), first + int(stops[longest]) - 1


def _tangents(position: FloatArray) -> FloatArray:
    """(N, 3) unit tangents of a line through points (N, 3)."""
    return unit(np.gradient(position, axis=0))


class _Beside:
    """Finds the points of candidates that are too near to a chosen line."""

    def __init__(self, trails: Trails, wishes: _Wishes) -> None:
        self._trails, self._wishes = trails, wishes
        self._there = np.flatnonzero(trails.there.reshape(-1))
        self._position = trails.points.position[self._there]
        self._normal = trails.points.normal[self._there].astype(np.float64)
        self._apart = wishes.apart[self._there // trails.there.shape[1]]
        self._tree = cKDTree(self._position) if len(self._there) else None

    def of(self, row: int, at: IntArray) -> IntArray:
        """Numbers of the points that lie too near to the points `at` of a line."""
        assert self._tree is not None
        points = self._trails.points.take(self._trails.index(row, at))
        reach = self._wishes.apart[row]
        near = self._tree.query_ball_point(points.position, reach)
        of = np.repeat(np.arange(len(at)), [len(found) for found in near])
        found = np.concatenate([np.asarray(n, np.int64) for n in near])
        apart = self._position[found] - points.position[of]
        along = np.einsum("nx,nx->n", apart, _tangents(points.position)[of])
        distance = np.sqrt((apart**2).sum(axis=1) + (_ALONG**2 - 1.0) * along**2)
        limit = np.maximum(np.minimum(self._apart[found], reach), _BESIDE * reach)
        facing = np.einsum("nx,nx->n", self._normal[found], points.normal[of]) > 0
        near_by: IntArray = self._there[found[(distance < limit) & facing]]
        return near_by
