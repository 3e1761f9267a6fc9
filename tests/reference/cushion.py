"""The wrinkles a second time, broad and soft: sampled coarsely, brought up by a cubic B-spline."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference.drawing import Wrinkles, meet
from reference.inputs import Array, Graph, Shape

THRESHOLD = 0.08
LEAST = 1.25  # coarse texels
WIDENED = 1.5
CARRIED = 1.5
UNEVEN = 1.6


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
    places = points * cushion.texels - 0.5
    first = np.floor(places.min(axis=0)).astype(int) - 1
    last = np.floor(places.max(axis=0)).astype(int) + 2
    u, v = (np.arange(first[i], last[i] + 1) for i in (0, 1))
    centres = (np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) + 0.5) / cushion.texels
    shape = Shape(wrinkle_bulge=0.0, sharpness=cushion.sharpness, slots=1)
    heights = -meet(centres, broadened(lines, cushion), None, shape)[0].reshape(len(v), len(u))
    across, up = (b_spline(places[:, i, None] - k) for i, k in ((0, u), (1, v)))
    return np.einsum("pi,pj,ij->p", up, across, heights, optimize=True)


def broadened(lines: Wrinkles, cushion: Cushion) -> Wrinkles:
    """As wide as the layer has them, less what the spline widens them by, and no less than samples
    carry. The mean of a line stays."""
    wide = lines.half_width * cushion.width * cushion.texels
    drawn = np.sqrt(np.maximum(wide**2 - WIDENED, LEAST**2))
    strength = lines.strength * wide / drawn
    return lines._replace(half_width=drawn / cushion.texels, strength=strength)
