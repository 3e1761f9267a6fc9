"""The wrinkles a second time, broad and soft: sampled coarsely, brought up by a cubic B-spline."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference.arcs import between
from reference.boxes import PointsByU
from reference.drawing import Wrinkles, around, meet, nearest
from reference.inputs import Array, Graph, Indices, Shape

THRESHOLD = 0.08
LEAST = 1.25  # coarse texels
WIDENED = 1.5
CARRIED = 1.5
UNEVEN = 1.6
SAMPLES = 7
HEADROOM = 1.2
MEETING = 8
LEAST_SCORE = 1e-6


class Cushion(NamedTuple):
    """share: of the depth.  width: half widths to one of the furrow.  texels: a side of the coarse
    map."""

    share: float
    width: float
    sharpness: float
    texels: int

    @classmethod
    def of(
        cls, graph: Graph, resolution: int, share: float, width: float, sharpness: float
    ) -> Cushion:
        """As coarse as carries the half widths of the lines that may swell."""
        fits = width_to_carry(graph) * width * resolution / CARRIED
        factors = [f for f in (2, 4, 8, 16) if f <= fits and resolution // f >= 64]
        return cls(share, width, sharpness, resolution // max(factors, default=2))


def width_to_carry(graph: Graph) -> float:
    """The median half width; where copies differ from what they copy less, by a half at most: that
    of the narrower, as often over as the other is wider, but no more than UNEVEN times."""
    width, swells = (np.asarray(graph.edge_half_width, np.float64), graph.edge_weight > THRESHOLD)
    median = np.median(width[swells])
    pairs = [] if graph.edge_copy_of is None else enumerate(graph.edge_copy_of)
    found = [sorted((width[i], width[of])) for i, of in pairs if of >= 0 and swells[i]]
    if not found:
        return float(median)
    at_seams = np.median([low * max(low / high, 1 / UNEVEN) for low, high in found])
    return float(np.clip(at_seams, median / 2, median))


def strengths(weight: ArrayLike, share: float) -> tuple[Array, Array]:
    """(M,) of the narrow and of the broad layer."""
    weight = np.asarray(weight, np.float64)
    return (1 - share) * weight, share * weight * np.clip(weight / THRESHOLD - 1, 0, 1)


def b_spline(x: ArrayLike) -> Array:
    """The uniform cubic B-spline around 0."""
    x = np.abs(np.asarray(x, np.float64))
    inner, outer = 2 / 3 - x**2 + x**3 / 2, (2 - x) ** 3 / 6
    return np.where(x < 1, inner, np.where(x < 2, outer, 0.0))


def raised(points: Array, lines: Wrinkles, cushion: Cushion) -> Array:
    """(P,) displacement of the broad layer at points (P, 2), in units of depth.

    lines: stretch is in, strengths are of the broad layer, half widths those of the furrows.
    """
    return through(points, cushion, lambda centres: heights(centres, lines, cushion))


def heights(centres: Array, lines: Wrinkles, cushion: Cushion) -> Array:
    """(P,) of the broad layer at samples with their centres at (P, 2), in units of depth."""
    shape = Shape(wrinkle_bulge=0.0, sharpness=cushion.sharpness, slots=1)
    return -meet(centres, broadened(lines, cushion), None, shape)[0]


def through(points: Array, cushion: Cushion, of: Callable[[Array], Array]) -> Array:
    """(P,) at points (P, 2), by the spline through what `of` has at the centres of samples."""
    places = points * cushion.texels - 0.5
    first = np.floor(places.min(axis=0)).astype(int) - 1
    last = np.floor(places.max(axis=0)).astype(int) + 2
    u, v = (np.arange(first[i], last[i] + 1) for i in (0, 1))
    centres = (np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) + 0.5) / cushion.texels
    found = of(centres).reshape(len(v), len(u))
    across, up = (b_spline(places[:, i, None] - k) for i, k in ((0, u), (1, v)))
    return np.einsum("pi,pj,ij->p", up, across, found, optimize=True)


def broadened(lines: Wrinkles, cushion: Cushion) -> Wrinkles:
    """As wide as the layer has them, less what the spline widens them by, and no less than samples
    carry. The mean of a line stays."""
    wide = lines.half_width * cushion.width * cushion.texels
    drawn = np.maximum(np.sqrt(np.maximum(wide**2 - WIDENED, 0.0)), np.minimum(wide, LEAST))
    strength = lines.strength * wide / drawn
    least = LEAST / cushion.texels
    return lines._replace(half_width=drawn / cushion.texels, strength=strength, least=least)


def samples(limit: float, exponent: float) -> Array:
    """(SAMPLES,) log stretches that the maps of the layer are drawn at.  limit: of log stretch.
    exponent: of depth, whose own limit is reached at 1.5 log(4) of it."""
    return np.linspace(-1, 1, SAMPLES) * min(limit, 1.5 * np.log(4.0) / exponent)


def step(cushion: Cushion, depth_scale: float, deepest: float, bits: int) -> float:
    """What code 1 stands for over the depth scale, in units of depth.  deepest: share of a line."""
    most = cushion.share * deepest + np.log(MEETING) / cushion.sharpness / depth_scale
    return float(HEADROOM * most / (2 ** (bits - 1) - 1))


class Owners(NamedTuple):
    """Of each sample the line that it answers by, -1 for none; where along that it lies; by how
    much its score is above that of the next line."""

    line: Indices
    place: Array
    margin: Array


def owners(centres: Array, lines: Wrinkles, cushion: Cushion) -> Owners:
    """Of samples with their centres at (P, 2): the line whose strength times (1 - t²)⁴ is largest.

    lines: strengths are of the broad layer, half widths those of the furrows in the neutral.
    """
    broad, unit = broadened(lines, cushion), cushion.sharpness / np.log(2.0)
    best = np.full(len(centres), LEAST_SCORE / unit)
    found = Owners(np.full(len(centres), -1), np.zeros(len(centres)), np.full(len(centres), np.inf))
    near, (low, high) = PointsByU(centres), around(broad)
    for i in np.flatnonzero(broad.strength.reshape(len(broad.segments), -1).any(axis=1)):
        rows = near.within(low[i], high[i])  # beyond these the score is 0
        share, distance = nearest(centres[rows], broad, i)
        half_width = between(broad.half_width[i], share)
        drawn = np.maximum(half_width, broad.least)
        t2 = np.minimum((distance / drawn) ** 2, 1.0)
        score = between(broad.strength[i], share) * half_width / drawn * (1 - t2) ** 4
        gap = np.where(score > 0, np.abs(score - best[rows]), np.inf)
        better = score > best[rows]
        found.margin[rows] = np.where(better, gap, np.minimum(found.margin[rows], gap))
        found.line[rows[better]], found.place[rows[better]] = i, share[better]
        best[rows] = np.maximum(best[rows], score)
    return found


def blended(maps: Array, r: Array, at: Array, depth: Array) -> Array:
    """(P,) from maps (SAMPLES, P) over the depth scale at log stretches `at`, by r (P,) and `depth`
    (P,), its depth scale."""
    place = np.interp(r, at, np.arange(SAMPLES))
    below = np.minimum(place.astype(int), SAMPLES - 2)
    share, column = place - below, np.arange(len(r))
    mixed = (1 - share) * maps[below, column] + share * maps[below + 1, column]
    found: Array = depth * mixed
    return found
