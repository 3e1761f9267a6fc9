"""Smooth scalar fields over the chart of a sample: what a face is sculpted and moved with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Field = NDArray[np.float64]


def hill(x: Field, y: Field, centre: tuple[float, float], width: tuple[float, float]) -> Field:
    """A Gaussian of height 1: `width` holds its standard deviations along x and y."""
    return np.exp(-0.5 * (((x - centre[0]) / width[0]) ** 2 + ((y - centre[1]) / width[1]) ** 2))


def pair(x: Field, y: Field, centre: tuple[float, float], width: tuple[float, float]) -> Field:
    """A hill and its mirror image at -x; each keeps height 1 where the other is far."""
    return hill(x, y, centre, width) + hill(x, y, (-centre[0], centre[1]), width)


def odd_pair(x: Field, y: Field, centre: tuple[float, float], width: tuple[float, float]) -> Field:
    """A hill at `centre` and its negative at -x: for movement across, away from the midplane."""
    return hill(x, y, centre, width) - hill(x, y, (-centre[0], centre[1]), width)


def ridge(x: Field, y: Field, points: Sequence[tuple[float, float]], width: float) -> Field:
    """A ridge of height 1 along the parabola through three points, mirrored at x = 0.

    It is a graph over |x|, of Gaussian section, and fades out beyond the ends of the parabola.
    """
    (x0, _), _, (x2, _) = points
    across = np.abs(x)
    curve = np.polyfit([p[0] for p in points], [p[1] for p in points], 2)
    slope = np.polyval(np.polyder(curve), across)
    distance = (y - np.polyval(curve, across)) / np.hypot(1, np.clip(slope, -2, 2))
    taper = 0.25 * (x2 - x0)
    inside = ramp(across, x0 - taper, x0 + taper) * ramp(across, x2 + taper, x2 - taper)
    height: Field = np.exp(-0.5 * (distance / width) ** 2) * inside
    return height


def ramp(x: ArrayLike, start: float, end: float) -> Field:
    """0 at `start`, 1 at `end`, with two vanishing derivatives at both (quintic smoothstep)."""
    t = np.clip((np.asarray(x, np.float64) - start) / (end - start), 0.0, 1.0)
    return t * t * t * (t * (6 * t - 15) + 10)


def through(x: ArrayLike, knots: Sequence[tuple[float, float]]) -> Field:
    """A monotone-preserving smooth curve through `knots` (x ascending), level beyond the ends."""
    x = np.asarray(x, np.float64)
    xs, ys = np.array(knots, np.float64).T
    low = np.clip(np.searchsorted(xs, x, side="right") - 1, 0, len(xs) - 2)
    tangent = _tangents(xs, ys)
    step = xs[low + 1] - xs[low]
    t = np.clip((x - xs[low]) / step, 0.0, 1.0)
    start, end = ys[low], ys[low + 1]
    value: Field = start + (end - start) * t * t * (3 - 2 * t)
    value += step * t * (1 - t) * (tangent[low] * (1 - t) - tangent[low + 1] * t)
    return value


def _tangents(xs: Field, ys: Field) -> Field:
    """Fritsch-Carlson slopes: the harmonic mean of the neighbours, 0 at a turn and at the ends."""
    slope = np.diff(ys) / np.diff(xs)
    product = slope[1:] * slope[:-1]
    total = slope[1:] + slope[:-1]
    inner = np.where(product > 0, 2 * product / np.where(product > 0, total, 1.0), 0.0)
    return np.concatenate([[0.0], inner, [0.0]])
