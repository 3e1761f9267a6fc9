"""Families of leaders: where each kind of them is, and which way it runs.

Leaders follow the preferred directions. Where skin folds two ways as much, as between the brows,
which a frown folds upright and a raise folds level, the preferred direction is one of the two or
neither, and level ones cross the others. A neck has rings, a frown a pair of upright lines, and a
lip creases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.fields import Factors, Fields

# Millimetres: the shortest leader along the preferred directions, and the longest; from one seed of
# leaders to the next.
SHORTEST, LONGEST = 8.0, 28.0
SEEDS = 3.2
# How much less skin has of these where long level ones lead.
_BEHIND = np.float32(0.85)
Values = Callable[[Fields, NDArray[Any], NDArray[Any]], Factors]


@dataclass(frozen=True)
class Family:
    """One kind of leaders.

    leading: (N,) how far skin has them, at triangles (N,) and uv (N, 2).  turn: (N,) radians to the
    left from the level direction to them.  number: of the family.  seeds: millimetres from seed to
    seed; below SEEDS they have seeds of their own.  pace: millimetres from point to point along
    them.  shortest, longest: millimetres.  apart, farther: millimetres between small ones, and how
    much farther the largest are from others.  least: size of the smallest, 0 to 1.  chance: the
    least factor of the distance, and how much larger it may be.  broad, deep: factors of how broad
    and how deep they are.  string: the most millimetres from one pore on a line to the next.
    crossed: whether others may cross them.  single: whether there is one alone, along which skin
    has it most, and which no line before it cuts.  winding: how far they wind about their
    direction, radians, and over which lengths, millimetres.  waves: lengths of those of their
    depth, millimetres, from, and by chance how much longer.  amplitude: of each of these; where
    their sum is below -1 a line is broken.  takes: of the shortening of skin, what one takes in its
    middle at rank 1, of what it would by itself.  strip: how far it takes that from, in pore
    spacings.
    """

    leading: Values
    turn: Values
    number: int = 0
    seeds: float = SEEDS
    pace: float = 1.4
    shortest: float = SHORTEST
    longest: float = LONGEST
    apart: float = 2.6
    farther: float = 3.4
    least: float = 0.12
    chance: tuple[float, float] = (0.65, 0.9)
    broad: float = 1.0
    deep: float = 1.0
    string: float = np.inf
    crossed: bool = True
    single: bool = False
    winding: tuple[tuple[float, float], ...] = ((0.15, 9.0), (0.16, 2.2))
    waves: tuple[tuple[float, float], ...] = ((1.0, 0.9), (2.4, 2.5), (7.0, 6.0))
    amplitude: float = 0.27
    takes: float = 2.2
    strip: float = 5.0


def _level(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    return np.zeros(len(triangle), np.float32)


def _upright(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    return np.full(len(triangle), 0.5 * np.pi, np.float32)


def _preferred(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    """How far skin has those along the preferred directions: less where long level ones lead."""
    crossing = np.minimum(fields.crossing(triangle, uv), np.float32(1.0))
    found: Factors = fields.leading(triangle, uv) * (np.float32(1.0) - _BEHIND * crossing)
    return found


PREFERRED = Family(_preferred, lambda f, *place: f.turn(*place))
CROSSING = Family(
    lambda f, *place: f.crossing(*place),
    _level,
    number=1,
    shortest=14.0,
    longest=60.0,
    apart=4.5,
    farther=2.0,
    least=0.6,
    winding=((0.12, 9.0), (0.2, 2.2)),
    amplitude=0.2,
)
RINGS = Family(
    lambda f, *place: f.rings(*place),
    _level,
    number=2,
    seeds=10.0,
    pace=1.5,
    shortest=45.0,
    longest=140.0,
    apart=19.0,
    farther=0.0,
    least=0.5,
    chance=(0.85, 0.45),
    broad=2.4,
    deep=2.2,
    winding=((0.15, 14.0), (0.08, 5.0)),
    waves=((8.0, 7.0), (18.0, 16.0), (36.0, 30.0)),
    amplitude=0.38,
)
# One line on each of the two crests, as long as that is, and no other within some millimetres.
FROWN_LEFT = Family(
    lambda f, *place: np.maximum(f.frown(*place), 0.0),
    _upright,
    number=3,
    shortest=10.0,
    longest=32.0,
    apart=12.0,
    farther=0.0,
    least=0.85,
    chance=(1.0, 0.0),
    broad=2.4,
    deep=0.8,
    crossed=False,
    single=True,
    winding=((0.12, 12.0), (0.1, 3.0)),
    amplitude=0.2,
    takes=4.0,
    strip=16.0,
)
FROWN_RIGHT = replace(
    FROWN_LEFT, number=4, leading=lambda f, *place: np.maximum(-f.frown(*place), 0.0)
)
# Lips have short ones, close together, across them and up to their border, of the same size
# whatever the distance of pores is.
CREASES = Family(
    lambda f, *place: f.creases(*place),
    lambda f, *place: f.upright(*place),
    number=5,
    seeds=1.0,
    pace=0.7,
    shortest=3.0,
    longest=9.0,
    apart=0.7,
    farther=0.7,
    least=0.25,
    chance=(0.5, 1.7),
    broad=0.4,
    deep=0.8,
    string=0.7,
    winding=((0.22, 5.0), (0.18, 1.5)),
    waves=((2.0, 2.0), (4.0, 3.0), (8.0, 6.0)),
    amplitude=0.35,
    takes=1.6,
    strip=3.0,
)
# A few leave each corner of the mouth as a fan, uneven, and reach some millimetres.
FANS = Family(
    lambda f, *place: f.fans(*place),
    lambda f, *place: f.fanned(*place),
    number=6,
    seeds=1.6,
    pace=0.8,
    shortest=5.0,
    longest=15.0,
    apart=3.0,
    farther=2.0,
    least=0.3,
    chance=(0.7, 0.9),
    broad=0.7,
    deep=0.3,
    winding=((0.1, 9.0), (0.08, 2.5)),
    waves=((1.6, 1.5), (4.0, 3.0), (9.0, 6.0)),
    crossed=False,
    takes=3.0,
)
# A neck has lines that slant to either side of the preferred ones and cross: rhombi that lie along
# these, uneven in size and in strength.
_SLANT = float(np.radians(34.0))
RHOMBI = tuple(
    Family(
        lambda f, *place: f.rhombi(*place),
        lambda f, *place, slant=slant: f.along_rhombi(*place) + np.float32(slant),
        number=number,
        shortest=7.0,
        longest=30.0,
        apart=1.7,
        farther=1.8,
        least=0.15,
        chance=(0.5, 2.4),
        broad=0.55,
        deep=1.25,
        winding=((0.2, 9.0), (0.16, 2.5)),
        amplitude=0.33,
        takes=1.2,
    )
    for number, slant in ((7, -_SLANT), (8, _SLANT))
)
# Of the level ones of a forehead a few run across it, a centimetre apart, and swell, fade and break
# in long waves; the others are smaller and lie between.
FURROWS = replace(
    CROSSING,
    number=9,
    seeds=6.0,
    shortest=35.0,
    longest=150.0,
    apart=9.5,
    farther=1.0,
    least=0.7,
    chance=(0.85, 0.4),
    broad=1.9,
    deep=1.1,
    winding=((0.16, 24.0), (0.12, 7.0)),
    waves=((7.0, 6.0), (16.0, 14.0), (34.0, 30.0)),
    amplitude=0.28,
    takes=4.0,
    strip=14.0,
)
# By number.
FAMILIES = (PREFERRED, CROSSING, RINGS, FROWN_LEFT, FROWN_RIGHT, CREASES, FANS, *RHOMBI, FURROWS)
# Those that come before the others, by their numbers, and which of these come first.
FIRST = {family.number: 0 for family in (RINGS, FROWN_LEFT, FROWN_RIGHT, FANS)} | {
    FURROWS.number: 1
}
# Those that expressions leave behind, beside those along the preferred directions.
_FOLDED = (CROSSING, FROWN_LEFT, FROWN_RIGHT)


def leading_any_way(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    """(N,) how far skin folds so that it has leaders of any family; rings do not count."""
    ways = fields.leading(triangle, uv), *(f.leading(fields, triangle, uv) for f in _FOLDED)
    found: Factors = np.max(ways, axis=0)
    return found


def leading_of(
    number: NDArray[Any], fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]
) -> Factors:
    """(N,) how far skin has leaders of families by their numbers (N,)."""
    found = leading_any_way(fields, triangle, uv)
    for family in (RINGS, CREASES, FANS, *RHOMBI):
        found = np.where(number == family.number, family.leading(fields, triangle, uv), found)
    return found
