"""What painted maps mean, in double: one point at a time, from the table of docs/artists.md."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array
from reference.stiffness import bilinear


def grey_at(maps: dict[int, Array], points: ArrayLike, other: float) -> Array:
    """(P,) of maps by UDIM at points (P, 2), UDIM included; `other` where the UDIM has none."""
    found = []
    for point in np.asarray(points, np.float64):
        corner = np.floor(point)
        map = maps.get(int(1001 + corner[0] + 10 * corner[1]))
        found.append(other if map is None else bilinear(map, [point - corner])[0])
    return np.array(found)


def signed(grey: float) -> float:
    """−1 at code 0 of 255, 0 from 127 to 128, 1 at 255; straight between."""
    return float(np.interp(255 * grey, [0, 127, 128, 255], [-1, 0, 0, 1]))


def density(grey: float) -> float:
    return (1 + signed(grey)) ** 2


def linear(grey: float) -> float:
    return 1 + signed(grey)


def sized(grey: float) -> float:
    return math.exp(math.log(4) * signed(grey))


def mixed_factor(base: float, masks: list[tuple[float, float]]) -> float:
    """Of the region that is left and of (weight, factor) pairs, by logarithms."""
    total = sum(weight for weight, _ in masks)
    share = max(total, 1.0)
    log = sum(weight / share * math.log(factor) for weight, factor in masks)
    return math.exp(log + max(1 - total, 0) * math.log(base))


def direction_on_surface(grey: float, jacobian: Array) -> Array:
    """(3,) the unit vector J·(cos, sin) of 180° times the grey."""
    angle = math.pi * grey
    vector = np.asarray(jacobian, np.float64) @ [math.cos(angle), math.sin(angle)]
    return vector / np.linalg.norm(vector)
