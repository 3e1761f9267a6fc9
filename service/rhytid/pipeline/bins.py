"""Precomputed maps of the fast method (section 2.4): which there are, and how they are coded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings, BinSettings, ResponseSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.pipeline.reach import SCALE_LIMIT

# What bulges and overlaps may add to the deepest furrow, in units of depth.
HEADROOM = 0.2
# The C type of a code, by its bits.
CODES = {8: "char", 16: "short"}
# Tilts are drawn from wrinkles whose depths are scaled by 1 ± this from edge to edge of a bin.
TILT_SHARE = 0.25
# Half bins from the middle of a bin to where the line through its depth scales is taken.
TILT_NODE = 0.6
# The layer of tilts; its maps follow those of all others.
TILTS = "wrinkle_tilts"


def directions(count: int, turn: float = 0.0) -> NDArray[np.float64]:
    """(N, 2) θₙ = (sin αₙ, cos αₙ) with αₙ = πn/N (Alg. 3, line 7).  turn: all of them, in bins."""
    angles = np.pi * (np.arange(count) + turn) / count
    return np.stack([np.sin(angles), np.cos(angles)], axis=1)


def sample_stretches(settings: AssetSettings, layer: int = 0) -> NDArray[np.float64]:
    """(M,) log stretch of each sample of a layer, evenly spaced around 0, which is the middle."""
    samples = settings.bins.layer_samples[layer]
    steps = np.arange(samples, dtype=np.float64) - (samples - 1) / 2
    return steps * (2.0 * settings.last_sample / (samples - 1))


def scale(
    response: ResponseSettings, r: float, exponent: float, most: float = SCALE_LIMIT
) -> float:
    """exp(r)^exponent within the limits of the response (Alg. 1, lines 7 and 8)."""
    if not response.soft_limits:
        return float(np.clip(math.exp(exponent * r), 1.0 / SCALE_LIMIT, most))
    return math.exp(held(exponent * r, math.log(SCALE_LIMIT), math.log(most)))


def held(x: float, low: float, high: float) -> float:
    """x kept within -low and high by a knee (HELD of limits.clh): x itself up to half of a limit,
    the limit from one and a half times it on, and a parabola between."""
    size, limit = abs(x), high if x > 0 else low
    past = min(max(size - 0.5 * limit, 0.0), limit)
    return math.copysign(min(size, 1.5 * limit) - past * past / (2.0 * limit), x)


@dataclass(frozen=True)
class ShareRange:
    """The least and the most share (`edge_share`) of a graph's wrinkles."""

    least: float = 1.0
    most: float = 1.0

    @classmethod
    def of(cls, graph: WrinkleGraph) -> ShareRange:
        """The range of a graph; 1 throughout where it has no shares."""
        share = graph.edge_share
        if share is None or not len(share):
            return EVEN
        return cls(float(share.min()), float(share.max()))

    def deepest(self, response: ResponseSettings, r: float) -> float:
        """How deep at log stretch r a wrinkle may be, of what it would be with share 1; at least 1
        (SHARED_DEPTH of shares.clh)."""
        shared = (1.0 - response.alpha_d * (s - 1.0) * r for s in (self.least, self.most))
        return min(max(1.0, *shared), SCALE_LIMIT)


EVEN = ShareRange()


def depth_limits(settings: AssetSettings) -> list[float]:
    """The largest depth scale of each layer, bins first, then the pores."""
    return [SCALE_LIMIT] * settings.bins.count + [settings.response.pore_depth_limit]


def drawn_depth_exponents(settings: AssetSettings) -> list[float]:
    """The exponent of stretch in the depth that maps of each layer are drawn with, bins first, then
    the pores: that of Alg. 1 and 2, or 0 where the depth scale is multiplied on later."""
    response, bins = settings.response, settings.bins
    if bins.depth_factored:
        return [0.0] * (bins.count + 1)
    return [response.alpha_d] * bins.count + [response.beta_d]


def tilt_width(settings: AssetSettings) -> float:
    """The factor of half widths where tilts are drawn: the largest that wrinkles have."""
    response = settings.response
    return scale(response, settings.last_sample, response.alpha_w)


def parts(bins: BinSettings) -> tuple[int, ...]:
    """The parts of the map of one bin and sample: one signed map, or valleys and bulges apart
    (draw.clh)."""
    return (1, 2) if bins.merge == "mellow" else (0,)


def layers(bins: BinSettings) -> dict[str, tuple[int, ...]]:
    """The layers of maps by name, each with the index of the first map of every bin of it.

    `wrinkles` and `pores`; of `mellow` these are the valleys, and `wrinkle_bulges` and
    `pore_bulges` are the bulges. Each has the maps of all samples. With tilts `wrinkle_tilts`, one
    map per bin.
    """
    count, samples = len(parts(bins)), bins.samples
    first = range(0, map_count(bins), count * samples + bins.tilt)[: bins.count + 1]  # of layers
    names = (("wrinkles", "pores"), ("wrinkle_bulges", "pore_bulges"))
    found: dict[str, tuple[int, ...]] = {}
    for part, (wrinkles, pores) in enumerate(names[:count]):
        found[wrinkles] = tuple(index + part * samples for index in first[:-1])
        found[pores] = (first[-1] + part * bins.layer_samples[-1],)
    if bins.tilt:
        found[TILTS] = tuple(index + count * samples for index in first[:-1])
    return found


def map_count(bins: BinSettings) -> int:
    """Precomputed maps of a tile: of every layer, part and sample, and the tilt of every bin."""
    tilts = bins.count if bins.tilt else 0
    return sum(bins.layer_samples) * len(parts(bins)) + tilts


def code_limit(bits: int) -> int:
    """The largest code of a symmetric quantisation."""
    return int(2 ** (bits - 1) - 1)


def map_argument(index: int, count: int) -> NDArray[np.int32]:
    """The argument of kernels that write codes of one map: its index, and how many maps there are.
    It is no define, so that the kernels are compiled once for all bins."""
    return np.array([index, count], np.int32)


def quantisation_steps(settings: AssetSettings, shares: ShareRange = EVEN) -> NDArray[np.float32]:
    """(N + 1, M) displacement of one code, mesh units; the last row is the pore layer. M is that
    of the layer with most samples; rows of fewer end in zeros.

    Known before anything is drawn, so that tiles can be made one at a time.  shares: of the graph.
    """
    assert settings.depth is not None
    bins = settings.bins
    found = np.zeros((bins.count + 1, max(bins.layer_samples)), np.float32)
    limits = depth_limits(settings)
    for layer, exponent in enumerate(drawn_depth_exponents(settings)):
        depths = np.array(
            [
                scale(settings.response, r, -exponent, limits[layer])
                for r in sample_stretches(settings, layer)
            ]
        )
        if shares != EVEN and layer < bins.count:
            stretches = sample_stretches(settings, layer)
            depths *= [shares.deepest(settings.response, r) for r in stretches]
        step = settings.depth * (depths + HEADROOM) / code_limit(bins.bits)
        found[layer, : len(depths)] = step
    return found
