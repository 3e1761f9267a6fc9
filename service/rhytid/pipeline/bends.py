"""Arcs and tapers of wrinkles as they are drawn, in UV, and the boxes around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import ORIGINAL, WrinkleGraph

Box = tuple[NDArray[np.floating], NDArray[np.floating]]


@dataclass(frozen=True)
class Bends:
    """What M wrinkles have at their first node and at their second, settings put in.

    slopes, weights, half_widths (M, 2) float32, as in WrinkleGraph.  partners (M, 2) int32, or None
    where the response does not ask for them.
    """

    slopes: NDArray[np.float32]
    weights: NDArray[np.float32]
    half_widths: NDArray[np.float32]
    partners: NDArray[np.int32] | None


def bends_of(graph: WrinkleGraph, settings: AssetSettings) -> Bends | None:
    """None where all wrinkles are straight, even and answer by themselves."""
    shape = settings.shape
    slopes = _share(None, graph.edge_slopes, shape.curvature)
    weights = _share(graph.edge_weight, graph.edge_end_weights, shape.taper)
    half_widths = _share(graph.edge_half_width, graph.edge_end_half_widths, shape.taper)
    partners = _partners(graph) if settings.response.ends > 0 else None
    if all(array is None for array in (slopes, weights, half_widths, partners)):
        return None
    none = np.zeros((graph.wrinkles, 2), np.float32)
    return Bends(
        none if slopes is None else slopes,
        _even(graph.edge_weight) if weights is None else weights,
        _even(graph.edge_half_width) if half_widths is None else half_widths,
        partners,
    )


def straight_box(ends: NDArray[np.float32]) -> Box:
    """Corners (M, 2) and (M, 2) of the boxes around segments, ends (M, 2, 2)."""
    return ends.min(axis=1), ends.max(axis=1)


def arc_box(
    ends: NDArray[np.float32],
    slopes: NDArray[np.float32],
    roots: NDArray[np.float64] | None = None,
) -> Box:
    """The same around arcs: an arc is a cubic Bézier curve, which stays within its four points.

    roots: (M, 3) of metrics in which they are arcs, as `metric_roots` has them, or None: in UV.
    """
    start, stop = ends[:, 0].astype(np.float64), ends[:, 1].astype(np.float64)
    along = stop - start
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) if roots is None else _left(along, roots)
    after, before = ((along + slopes[:, end, None] * left) / 3.0 for end in (0, 1))
    points = np.stack([start, start + after, stop - before, stop])
    return points.min(axis=0), points.max(axis=0)


def _left(along: NDArray[np.float64], roots: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 2) in UV what is to the left of steps (M, 2) in a metric, and as long there."""
    xx, xy, yy = roots.T
    ahead = xx * along[:, 0] + xy * along[:, 1]
    v = ahead / yy
    return np.stack([(-yy * along[:, 1] - xy * v) / xx, v], axis=1)


def _share(
    even: NDArray[np.float32] | None, ends: NDArray[np.float32] | None, share: float
) -> NDArray[np.float32] | None:
    """(M, 2) between what a wrinkle has throughout, None for 0, and what it has at its ends."""
    if ends is None or share == 0.0:
        return None
    throughout = np.float32(0.0) if even is None else even[:, None]
    found: NDArray[np.float32] = throughout + np.float32(share) * (ends - throughout)
    return found


def _even(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.stack([values, values], axis=1)


def _partners(graph: WrinkleGraph) -> NDArray[np.int32] | None:
    """(M, 2), in place of copies what they are of: both answer alike."""
    partners, copy_of = graph.edge_partners, graph.edge_copy_of
    if partners is None or copy_of is None:
        return partners
    first = copy_of[np.maximum(partners, 0)]
    return np.where((partners < 0) | (first == ORIGINAL), partners, first)
