"""Wrinkles that bend, taper and answer at their ends, under soft limits: what the graph's optional
arrays and the settings beside them mean."""

from __future__ import annotations

from typing import Any

import numpy as np

from reference.drawing import Pores, Wrinkles
from reference.inputs import Array
from reference.redraw import ORIGIN, line_metric, pores, segments
from reference.response import WIDEST


def held(x: Array, low: float, high: float) -> Array:
    """x within -low and high by a knee: itself up to half the limit, the limit from one and a half
    times it on, and the parabola between that continues both."""
    limit = np.where(x > 0, high, low)
    u = np.abs(x) / limit
    knee = u - (u - 0.5) ** 2 / 2
    return np.sign(x) * limit * np.where(u <= 0.5, u, np.where(u < 1.5, knee, 1.0))


def scale(r: Array, exponent: float, soft: bool, most: float = WIDEST) -> Array:
    """σ of a log stretch."""
    low, high = np.log(WIDEST), np.log(most)
    x = exponent * np.asarray(r, np.float64)
    return np.exp(held(x, low, high) if soft else np.clip(x, -low, high))


def at_ends(r: Array, partners: Array | None, share: float) -> Array:
    """(M, 2) r at both ends: `share` of the way to the mean with the wrinkle that goes on."""
    found = np.repeat(np.asarray(r, np.float64)[:, None], 2, axis=1)
    if partners is None:
        return found
    for i, end in np.argwhere(partners >= 0):
        found[i, end] += share * 0.5 * (r[partners[i, end]] - r[i])
    return found


# The most of the depth scale of a wrinkle with shares.
MOST_SHARED = 7.0


def shared_depth(r: Array, exponent: float, share: Array) -> Array:
    """How deep a wrinkle is at log stretch r that takes `share` of what it would take of the
    shortening of skin, of what it would be: linear in r, within 0 and the limit of scales."""
    return np.clip(1.0 - exponent * (np.asarray(share, np.float64) - 1.0) * r, 0.0, WIDEST)


def lines(graph: Any, r: Array, response: Any, shape: Any, texel: float, origin: Any) -> Wrinkles:
    """Of the edges at log stretches r (M,), `texel` wide in UV."""
    ends = at_ends(r, graph.edge_partners, response.ends)
    width = scale(ends, response.alpha_w, response.soft_limits)
    depth = scale(ends, -response.alpha_d, response.soft_limits)
    if graph.edge_share is not None:
        shares = at_ends(graph.edge_share, graph.edge_partners, response.ends)
        depth *= shared_depth(ends, response.alpha_d, shares)
    half_width = tapering(graph.edge_half_width, graph.edge_end_half_widths, shape.taper)
    weight = tapering(graph.edge_weight, graph.edge_end_weights, shape.taper)
    if graph.edge_share is not None:
        depth = np.minimum(depth, np.minimum(WIDEST / np.maximum(weight, 1e-9), MOST_SHARED))
    weight *= (np.asarray(graph.edge_weight) > 0)[:, None]
    slopes = np.zeros_like(width) if graph.edge_slopes is None else graph.edge_slopes
    return Wrinkles(
        segments(graph, origin), half_width * width, weight * depth,
        slopes=shape.curvature * np.asarray(slopes, np.float64),
        least=shape.least_half_width * texel, metric=line_metric(graph),
    )  # fmt: skip


def tapering(even: Any, ends: Any, share: float) -> Array:
    """(M, 2) from what a wrinkle has throughout to what it has at its ends."""
    throughout = np.repeat(np.asarray(even, np.float64)[:, None], 2, axis=1)
    return throughout if ends is None else throughout + share * (ends - throughout)


def discs(
    graph: Any, r: Array, response: Any, shape: Any, texel: float, origin: Any = ORIGIN
) -> Pores:
    """Of the nodes at log stretches r (N,)."""
    soft, most = response.soft_limits, response.pore_depth_limit
    width = scale(r, response.beta_w, soft)
    depth = scale(r, -response.beta_d, soft, most)
    return pores(graph, width, depth, origin)._replace(least=shape.least_half_width * texel)
