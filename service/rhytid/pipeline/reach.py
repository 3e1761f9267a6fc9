"""The shapes of wrinkles and pores in UV as settings have them drawn, arcs and tapers among them,
how far they reach at any stretch, and how much they may cover."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.errors import LimitError
from rhytid.pipeline.cells import CellLists, list_by_cell, stable_order
from rhytid.pipeline.copies import metric_roots, rim_reach
from rhytid.pipeline.work import BLOCK, work_by_cell

Box = tuple[NDArray[np.floating], NDArray[np.floating]]
# σ_w and σ_d are kept in [1/SCALE_LIMIT, SCALE_LIMIT].
SCALE_LIMIT = 4.0
# Texels that may be covered for each texel of the map, all elements together.
_MOST_COVER = 4096.0
_MARGIN = 1.001  # beyond the rounding of the scales on the device


def response_defines(soft_limits: bool) -> dict[str, object]:
    """The defines of response.clh."""
    soft = {"SOFT_LIMITS": 1} if soft_limits else {}
    return {"SCALE_LIMIT": f"{SCALE_LIMIT}f", **soft}


def bulging(shape: ShapeSettings) -> bool:
    """Whether the profile of any element changes sign."""
    return max(shape.wrinkle_bulge, shape.pore_bulge) > 1.0


def widest(exponent: float, log_stretch_limit: float) -> float:
    """The largest width scale that a log stretch within the limit can give."""
    return _MARGIN * min(math.exp(exponent * log_stretch_limit), SCALE_LIMIT)


def around_wrinkles(
    graph: WrinkleGraph,
    lines: Box,
    settings: AssetSettings,
    bends: Bends | None,
    waves: NDArray[np.float32] | None = None,
    broader: float = 1.0,
    least: float = 0.0,
) -> Box:
    """Corners (M, 2) and (M, 2) of the boxes around wrinkles at any stretch.

    lines: the boxes of `boxes_of_lines`.  broader: than the graph has them.  least: half width, in
    UV.
    """
    response = settings.response
    scale = widest(response.alpha_w, response.log_stretch_limit)
    half_width = graph.edge_half_width if bends is None else np.maximum(*bends.half_widths.T)
    reach = np.maximum(half_width * (scale * broader), max(least, least_half_width(settings)))[
        :, None
    ]
    if waves is not None:
        reach = reach + np.abs(waves[:, :1])
    low, high = lines
    if graph.edge_metric is None:
        return low - reach, high + reach
    rows = np.flatnonzero(graph.edge_metric.any(axis=1))
    wider = reach[rows] / graph.edge_half_width[rows, None]
    reach = np.repeat(reach, 2, axis=1)
    reach[rows] = wider * rim_reach(metric_roots(graph.edge_metric[rows]))
    return low - reach, high + reach


def boxes_of_lines(graph: WrinkleGraph, ends: NDArray[np.float32], bends: Bends | None) -> Box:
    """Corners (M, 2) and (M, 2) of the boxes around the wrinkles of ends (M, 2, 2), without their
    width."""
    if bends is None:
        return straight_box(ends)
    low, high = arc_box(ends, bends.slopes)
    if graph.edge_metric is not None:
        rows = np.flatnonzero(graph.edge_metric.any(axis=1))
        roots = metric_roots(graph.edge_metric[rows])
        low[rows], high[rows] = arc_box(ends[rows], bends.slopes[rows], roots)
    return low, high


def around_pores(
    centres: NDArray[np.float32],
    root: NDArray[np.float64],
    settings: AssetSettings,
    scale: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (N, 2) and (N, 2) of the boxes around pores at any stretch.

    scale: (N, 1) the largest width scale of each; None: that of pores.
    """
    response = settings.response
    wide = widest(response.beta_w, response.log_stretch_limit) if scale is None else scale
    reach = rim_reach(root) * wide
    if least := least_half_width(settings):  # of an ellipse no axis of which is below it
        reach = np.hypot(reach, least)
    return centres - reach, centres + reach


def pore_roots(graph: WrinkleGraph) -> NDArray[np.float64]:
    """(N, 3) Cholesky factors (xx, xy, yy) of the metrics, UV units: rootᵀ·root = metric."""
    if graph.node_metric is None:
        across = 1.0 / graph.node_radius.astype(np.float64)
        return np.stack([across, np.zeros_like(across), across], axis=1)
    return metric_roots(graph.node_metric)


def sizes_of_ends(
    graph: WrinkleGraph, bends: Bends | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Half widths and weights, (M, 1), or (M, 2) at both ends where there are bends."""
    if bends is None:
        return graph.edge_half_width[:, None], graph.edge_weight[:, None]
    return bends.half_widths, bends.weights


def least_half_width(settings: AssetSettings) -> float:
    """The least half width in UV."""
    return settings.shape.least_half_width / settings.resolution


@dataclass(frozen=True)
class Bends:
    """Values of M wrinkles at their first node and at their second, with settings applied.

    slopes, weights, half_widths (M, 2) float32, as in WrinkleGraph.  partners (M, 2) int32, or None
    where the response does not ask for them.  shares (M, 2) float32, those of
    partners in part; None where all are 1.
    """

    slopes: NDArray[np.float32]
    weights: NDArray[np.float32]
    half_widths: NDArray[np.float32]
    partners: NDArray[np.int32] | None
    shares: NDArray[np.float32] | None


def bends_of(graph: WrinkleGraph, settings: AssetSettings) -> Bends | None:
    """The bends of a graph's wrinkles; None where all are straight and even, respond by themselves
    and take the same share."""
    shape = settings.shape
    slopes = _share(None, graph.edge_slopes, shape.curvature)
    weights = _share(graph.edge_weight, graph.edge_end_weights, shape.taper)
    half_widths = _share(graph.edge_half_width, graph.edge_end_half_widths, shape.taper)
    partners = _partners(graph) if settings.response.ends > 0 else None
    given = slopes, weights, half_widths, partners, graph.edge_share
    if all(array is None for array in given):
        return None
    none = np.zeros((graph.wrinkles, 2), np.float32)
    return Bends(
        none if slopes is None else slopes,
        _even(graph.edge_weight) if weights is None else weights,
        _even(graph.edge_half_width) if half_widths is None else half_widths,
        partners,
        _shares(graph.edge_share, partners, settings.response.ends),
    )


def _shares(
    share: NDArray[np.float32] | None, partners: NDArray[np.int32] | None, ends: float
) -> NDArray[np.float32] | None:
    """(M, 2) shares (M,) at both ends: where a partner goes on, `ends` of the way to the mean."""
    if share is None:
        return None
    found = _even(share)
    if partners is not None:
        mean = np.float32(0.5) * (found + share[np.maximum(partners, 0)])
        found += np.float32(ends) * np.where(partners >= 0, mean - found, np.float32(0.0))
    return found


def straight_box(ends: NDArray[np.float32]) -> Box:
    """Corners (M, 2) and (M, 2) of the boxes around segments, ends (M, 2, 2)."""
    return ends.min(axis=1), ends.max(axis=1)


def arc_box(
    ends: NDArray[np.float32],
    slopes: NDArray[np.float32],
    roots: NDArray[np.float64] | None = None,
) -> Box:
    """Corners (M, 2) and (M, 2) of the boxes around arcs. An arc is a cubic Bézier curve, which
    stays within its four points.

    slopes (M, 2): at both ends.  roots: (M, 3) of metrics in which they are arcs, as `metric_roots`
    has them, or None: in UV.
    """
    start, stop = ends[:, 0].astype(np.float64), ends[:, 1].astype(np.float64)
    along = stop - start
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) if roots is None else _left(along, roots)
    after, before = ((along + slopes[:, end, None] * left) / 3.0 for end in (0, 1))
    points = np.stack([start, start + after, stop - before, stop])
    return points.min(axis=0), points.max(axis=0)


def _left(along: NDArray[np.float64], roots: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 2) vectors in UV that in the metric of roots (M, 3) lie to the left of steps (M, 2) and
    are as long."""
    xx, xy, yy = roots.T
    ahead = xx * along[:, 0] + xy * along[:, 1]
    v = ahead / yy
    return np.stack([(-yy * along[:, 1] - xy * v) / xx, v], axis=1)


def _share(
    even: NDArray[np.float32] | None, ends: NDArray[np.float32] | None, share: float
) -> NDArray[np.float32] | None:
    """(M, 2) values at ends, `share` of the way from the value of the whole wrinkle, `even` (M,) or
    0 for None, to that of the end, `ends` (M, 2)."""
    if ends is None or share == 0.0:
        return None
    throughout = np.float32(0.0) if even is None else even[:, None]
    found: NDArray[np.float32] = throughout + np.float32(share) * (ends - throughout)
    return found


def _even(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.stack([values, values], axis=1)


def _partners(graph: WrinkleGraph) -> NDArray[np.int32] | None:
    """(M, 2) partners, with originals in place of copies: both respond alike."""
    partners, copy_of = graph.edge_partners, graph.edge_copy_of
    if partners is None or copy_of is None:
        return partners
    first = copy_of[np.maximum(partners, 0)]
    return np.where((partners < 0) | (first == ORIGINAL), partners, first)


def drawn_rows(
    weight: NDArray[np.float32], low: NDArray[np.floating], high: NDArray[np.floating]
) -> NDArray[np.int64]:
    """The rows of elements that are drawn, sorted by the block of the centre for locality of
    memory."""
    members = np.flatnonzero(reaching_in(weight, low, high))
    cell = np.clip((low[members] + high[members]) * 128.0, 0, 255).astype(np.int64)
    return members[stable_order(cell[:, 1] * 256 + cell[:, 0], 256 * 256)]


def reaching_in(
    weight: NDArray[np.float32] | NDArray[np.bool_],
    low: NDArray[np.floating],
    high: NDArray[np.floating],
) -> NDArray[np.bool_]:
    """(K,) whether elements have a weight above 0 and boxes, corners (K, 2) in UV, that reach into
    the UDIM."""
    # Column by column, since numpy takes long over short rows.
    (left, bottom), (right, top) = low.T, high.T
    inside: NDArray[np.bool_] = (weight > 0) & (right > 0) & (top > 0) & (left < 1) & (bottom < 1)
    return inside


def list_by_block(
    low: NDArray[np.floating], high: NDArray[np.floating], resolution: int
) -> CellLists:
    """Lists of the elements in every block of a map, top row first, and how much work they are.
    low, high: (K, 2) in UV."""
    texel = 1.0 / resolution
    lists = list_by_cell(low - texel, high + texel, resolution // BLOCK, top_down=True)
    return replace(lists, work=work_by_cell(lists, low, high))


def limit_cover(
    low: NDArray[np.floating],
    high: NDArray[np.floating],
    resolution: int,
    what: str,
    udim: int,
    factor: int = 1,
) -> None:
    """Raise LimitError where boxes (K, 2) in UV cover too many texels of a UDIM in all.

    what: names the elements in the message.  factor: texels per sample of what is drawn.
    """
    size = np.maximum(np.minimum(high, 1.0) - np.maximum(low, 0.0), 0.0)
    cover = float(np.prod(size, axis=1, dtype=np.float64).sum()) / factor**2
    if cover > _MOST_COVER:
        raise LimitError(
            f"the {what} cover {cover:.0f} times the map of UDIM {udim} at their widest: "
            f"more than {_MOST_COVER:.0f} (at {resolution}² texels)"
        )
