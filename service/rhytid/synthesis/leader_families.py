"""Families of leaders: where each kind of them is, and which way it runs.

Leaders follow the preferred directions. Where skin folds two ways as much, as between the brows,
which a frown folds upright and a raise folds level, the preferred direction is one of the two or
neither, and level ones cross the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.fields import Factors, Fields

# Millimetres: the shortest leader along the preferred directions, and the longest.
SHORTEST, LONGEST = 7.0, 20.0
Values = Callable[[Fields, NDArray[Any], NDArray[Any]], Factors]


@dataclass(frozen=True)
class Family:
    """One kind of leaders.

    leading: (N,) how far skin has them, at triangles (N,) and uv (N, 2).  turn: (N,) radians to the
    left from the level direction to them.  salt: of random numbers.  seeds: millimetres from seed
    to seed.  shortest, longest: millimetres.  apart, farther: millimetres between small ones, and
    how much farther the largest are from others.  least: size of the smallest, 0 to 1.  winding:
    how far they wind about their direction, radians, and over which lengths, millimetres.
    """

    leading: Values
    turn: Values
    salt: int = 0
    seeds: float = 2.4
    shortest: float = SHORTEST
    longest: float = LONGEST
    apart: float = 2.6
    farther: float = 3.4
    least: float = 0.12
    winding: tuple[tuple[float, float], ...] = ((0.15, 9.0), (0.2, 2.2), (0.14, 0.8))


def _level(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    return np.zeros(len(triangle), np.float32)


PREFERRED = Family(lambda f, *place: f.leading(*place), lambda f, *place: f.turn(*place))
CROSSING = Family(
    lambda f, *place: f.crossing(*place),
    _level,
    salt=1,
    shortest=12.0,
    longest=34.0,
    apart=4.5,
    farther=2.0,
    least=0.6,
    winding=((0.12, 9.0), (0.14, 2.2), (0.1, 0.8)),
)
FAMILIES = (PREFERRED, CROSSING)


def leading_any_way(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
    """(N,) how far skin has leaders of any family."""
    found: Factors = np.max([f.leading(fields, triangle, uv) for f in FAMILIES], axis=0)
    return found
