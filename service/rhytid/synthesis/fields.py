"""Properties of the skin by place, as synthesis uses them; here the same everywhere. And the
preferred directions of its lines: a smooth field of directions, bent by smooth noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.skin import WHOLE_FACE
from rhytid.synthesis.progress import Progress, over_rows
from rhytid.synthesis.surface import FloatArray, Points, unit

Factors = NDArray[np.float32]
_WAVES = 24
# Places whose waves are added up at a time: what is computed on the way stays in the cache.
_ROWS = 2048
# The field of a face looks along z with y up; this share of x keeps the top of a head from
# having no direction at all.
_UP, _RIGHT = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
_FALLBACK = 0.2
# Strength (radians) and size (pore spacings) of the waves that bend the lines.
_BEND = ((0.35, 60.0), (0.35, 12.0))


class Fields:
    """Properties of even skin; subclasses vary them by place.

    Every method takes the triangle (N,) and uv (N, 2) of points and returns (N,) float32. Methods
    are called with some ten thousand points at a time, by several threads.

    least_spacing, most_spacing: limits of `spacing`, above 0. Two pores stand apart by the radius
    times the mean of their factors.  detail: UV length within which spacing and bareness hardly
    change.  looks: at how many places from pore to pore the densest of a triangle is looked for;
    below 1 where looking is dear and misses nothing.  some_bare: whether `bare` is true anywhere.
    some_contrast: whether `contrast` differs from 1 anywhere.  some_leading: whether leaders
    of any family may be anywhere.  usual_pore_radius: `pore_radius` where nothing is painted.
    most_events: of `events`.
    """

    least_spacing = 1.0
    most_spacing = 1.0
    detail = float("inf")
    looks = 1.0
    some_bare = False
    some_contrast = False
    some_leading = False
    usual_pore_radius = 1.0
    most_events = 1.0

    @property
    def unpatched(self) -> Fields:
        """These without patches: by them pores and wrinkles are counted."""
        return self

    def spacing(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the distance between pores."""
        return np.ones(len(triangle), np.float32)

    def closest(self, triangle: NDArray[Any]) -> Factors:
        """(N,) factors that `spacing` is nowhere below in triangles (N,)."""
        return np.full(len(triangle), self.least_spacing, np.float32)

    def bare(self, triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether skin is bare, that is without pores: (N,) bool."""
        return np.zeros(len(triangle), np.bool_)

    def strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of wrinkles; weights stay within (0, 1]."""
        return np.ones(len(triangle), np.float32)

    def pore_strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of pores."""
        return self.strength(triangle, uv)

    def contrast(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Power of the weight of wrinkles, taken before factors; called only where `some_contrast`
        is true."""
        return np.ones(len(triangle), np.float32)

    def primary(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the strength of primary lines."""
        return np.ones(len(triangle), np.float32)

    def leading(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has leaders, few long deep lines: 0 not at all, 1 as far as any."""
        return np.zeros(len(triangle), np.float32)

    def crossing(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has long level leaders whatever else folds it, as `leading`."""
        return np.zeros(len(triangle), np.float32)

    def frown(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has one of the two upright leaders of a frown: 0 to 1 the left one, 0 to
        -1 the right one."""
        return np.zeros(len(triangle), np.float32)

    def fans(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has leaders that leave a corner of the mouth as a fan: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def fanned(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to the leaders of a fan."""
        return np.zeros(len(triangle), np.float32)

    def rings(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has rings, long soft level lines: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def rhombi(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has rhombi, slanting lines that cross: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def along_rhombi(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to the long way of rhombi."""
        return self.turn(triangle, uv)

    def creases(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has creases, upright lines close together: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def creased(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin is of a region with creases, which end within its border: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def crumpled(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin whose lines are uneven folds without one direction: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def uneven(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far lines differ from those beside them where skin has leaders: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def rays(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin is of a region from whose border age draws rays: 0 to 1."""
        return np.zeros(len(triangle), np.float32)

    def turn(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians by which the preferred direction turns left, seen from outside."""
        return np.zeros(len(triangle), np.float32)

    def slant(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians by which the main lines run to the right of the preferred direction."""
        return np.zeros(len(triangle), np.float32)

    def upright(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to creases: a right angle."""
        return np.full(len(triangle), 0.5 * np.pi, np.float32)

    def bend(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of how far lines wind about the preferred direction."""
        return np.ones(len(triangle), np.float32)

    def anisotropy(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far walkers follow preferred directions: 1 as usual, 0 not at all. Above 1 the second
        family of lines turns towards the first; at 2 both are one."""
        return np.ones(len(triangle), np.float32)

    def width(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the width of wrinkles."""
        return np.ones(len(triangle), np.float32)

    def grain(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the micro relief between lines."""
        return np.ones(len(triangle), np.float32)

    def undulation(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the broad swells of the skin."""
        return np.ones(len(triangle), np.float32)

    def patchiness(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin varies from patch to patch; 0 for even skin."""
        return np.zeros(len(triangle), np.float32)

    def pore_radius(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the radius of pores."""
        return np.ones(len(triangle), np.float32)

    def of_regions(
        self, values: Mapping[str, float], triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """Values that every region has, by its name, mixed as the regions are at points."""
        return np.full(len(triangle), values[WHOLE_FACE], np.float32)

    def events(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the number of events, at most `most_events`."""
        return np.ones(len(triangle), np.float32)

    def event_strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the height of events, at most 1."""
        return np.ones(len(triangle), np.float32)

    def event_patches(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the height of events that follow patches."""
        return np.ones(len(triangle), np.float32)


def looked_up(
    look: Callable[[NDArray[Any], NDArray[Any]], NDArray[np.floating]], points: Points
) -> Factors:
    """(N,) what a method of fields says of points, on as many threads as there are cores."""
    found = np.empty(len(points), np.float32)

    def find(rows: slice) -> None:
        found[rows] = look(points.triangle[rows], points.uv[rows])

    over_rows(len(points), find)
    return found


class Directions:
    """A smooth field of directions, the same in every call.

    It approximates relaxed skin tension lines: level around the vertical axis (y), as on the
    forehead, the eyelids and the neck, bent by smooth noise at two sizes.
    """

    def __init__(self, spacing: float, rng: np.random.Generator, fields: Fields) -> None:
        self._noises = [(bend, SmoothNoise(size * spacing, rng)) for bend, size in _BEND]
        self._fields = fields

    def frames(
        self, points: Points, progress: Progress
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(N, 3) unit tangents along the main lines, and those a right angle to the left."""
        along, left = (np.empty((len(points), 3), np.float32) for _ in range(2))
        progress(0.0, "directions")

        def lay(rows: slice) -> None:
            place = points.triangle[rows], points.uv[rows]
            bend = self._fields.bend(*place).astype(np.float32)
            angle = self._fields.turn(*place).astype(np.float32)
            angle = angle - self._fields.slant(*place)
            angle = angle + bend * self._bend(points.position[rows])
            cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
            normal = points.normal[rows].astype(np.float64)
            level = level_directions(normal)
            beside = np.cross(normal, level)
            along[rows] = cosine * level + sine * beside
            left[rows] = cosine * beside - sine * level

        over_rows(len(points), lay)
        return along, left

    def _bend(self, position: FloatArray) -> NDArray[np.float32]:
        bends = [np.float32(bend) * noise.at(position) for bend, noise in self._noises]
        total: NDArray[np.float32] = np.sum(bends, axis=0, dtype=np.float32)
        return total


def level_directions(normal: FloatArray) -> FloatArray:
    """(N, 3) unit tangents around the vertical axis (y) where the surface has normals (N, 3)."""
    level = np.cross(_UP, normal) + _FALLBACK * _RIGHT
    level -= normal * np.einsum("nx,nx->n", level, normal)[:, None]
    return unit(level)


class SmoothNoise:
    """Values of mean 0 and deviation 1 that change over about `size`: a sum of plane waves.

    They depend on the place alone, counted from the origin of the mesh's coordinates.
    """

    def __init__(self, size: float, rng: np.random.Generator) -> None:
        self._waves = (rng.normal(size=(3, _WAVES)) / size)[..., None]
        self._phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)[:, None]

    def at(self, position: FloatArray) -> NDArray[np.float32]:
        """(N,) values at positions (N, 3)."""
        found = np.empty(len(position), np.float32)
        for start in range(0, len(position), _ROWS):
            rows = slice(start, start + _ROWS)
            # One by one: a matrix product may round a row by where in the array it is.
            x, y, z = np.ascontiguousarray(position[rows].T)
            angle = x * self._waves[0]
            angle += y * self._waves[1]
            angle += z * self._waves[2]
            angle += self._phases
            # Turns are taken off in double; what is left is small enough for single.
            turns = angle / (2.0 * np.pi)
            np.rint(turns, out=turns)
            turns *= 2.0 * np.pi
            angle -= turns
            found[rows] = _sum_of_waves(np.cos(angle.astype(np.float32)))
        found *= np.float32(np.sqrt(2.0 / _WAVES))
        return found


def _sum_of_waves(waves: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N,) sums of waves (_WAVES, N): of every eighth first, and then in pairs, the order in which
    numpy adds up as many values that lie side by side."""
    eight = waves[:8] + waves[8:16]
    eight += waves[16:]
    four = eight[::2] + eight[1::2]
    two = four[::2] + four[1::2]
    found: NDArray[np.float32] = two[0] + two[1]
    return found
