"""The fast method: maps drawn ahead by angle and stretch, blended by texel (section 2.4, Alg. 3).

A layer is one bin of wrinkles or, last, the pores. A layer has one map a stretch sample (`min`),
or two, valleys and bulges (`mellow`): the `side` axis below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference import redraw
from reference.drawing import Pores, Wrinkles, meet, mellow_max
from reference.inputs import Array, Bins, Graph, Indices, Response, Shape
from reference.response import on_surface, pore_stretch, scales, wrinkle_stretch

HEADROOM = 0.2


def angles(count: int) -> Array:
    """(N,) αₙ = πn/N."""
    return np.pi * np.arange(count) / count


def directions(count: int) -> Array:
    """(N, 2) θₙ = (sin αₙ, cos αₙ): n = 0 runs along v, north to south."""
    return np.stack([np.sin(angles(count)), np.cos(angles(count))], axis=-1)


def assign(direction: ArrayLike, count: int) -> tuple[Indices, Array]:
    """The bin nearest in angle, mod π (the lower on a tie), and the margin in radians by which
    it is nearer than the next, halved. direction: (M, 2)."""
    direction = np.asarray(direction, np.float64)
    angle = np.arctan2(direction[:, 0], direction[:, 1])
    turn = angle[:, None] - angles(count)
    away = np.abs(turn - np.pi * np.rint(turn / np.pi))
    ordered = np.sort(away, axis=-1)
    margin = (ordered[:, 1] - ordered[:, 0]) / 2 if count > 1 else np.full(len(away), np.inf)
    return away.argmin(axis=-1), margin


def samples(bins: Bins) -> Array:
    """(M,) log stretches at which the maps are drawn."""
    return np.linspace(-bins.r_max, bins.r_max, bins.samples)


def steps(bins: Bins, depth: float, depth_exponent: float) -> Array:
    """(M,) displacement of one code: depth·(σ_d(r_m) + 0.2)/(2^(bits - 1) - 1).

    With `depth_factored` the map holds no σ_d, which then counts as 1.
    """
    _, sigma_d = scales(samples(bins), 0.0, 0.0 if bins.depth_factored else depth_exponent)
    return depth * (sigma_d + HEADROOM) / (2 ** (bins.bits - 1) - 1)


def quantise(values: ArrayLike, step: float, bits: int) -> Indices:
    """Symmetric integer code, 0 for 0; beyond the headroom it saturates."""
    most = 2 ** (bits - 1) - 1
    return np.clip(np.rint(np.asarray(values, np.float64) / step), -most, most).astype(np.int64)


def layer_stretch(
    log_ratios: ArrayLike, axes: ArrayLike, count: int, jacobian: Array | None = None
) -> Array:
    """(N + 1, ...) r of every layer: Alg. 1 with θₙ (one bin: the mean), then Alg. 2 for pores.

    log_ratios: (..., 2), clamped to the limit of log stretch, not to r_max.  axes: (..., 2, 2).
    jacobian: (..., 2, 2), to take angles on the surface.
    """
    mean = pore_stretch(log_ratios)
    if count == 1:
        return np.stack([mean, mean])
    thetas = [*directions(count)]
    if jacobian is not None:
        axes = on_surface(jacobian[..., None, :, :], axes)
        thetas = [on_surface(jacobian, theta) for theta in thetas]
    bins = [wrinkle_stretch(log_ratios, axes, theta) for theta in thetas]
    return np.stack([*bins, mean])


def blend_weights(r: ArrayLike, bins: Bins) -> tuple[Indices, Array]:
    """The sample below r, clamped to ±r_max, and the share (0 to 1) of the sample above it."""
    last = bins.samples - 1
    r = np.clip(np.asarray(r, np.float64), -bins.r_max, bins.r_max)
    place = (r + bins.r_max) / (2 * bins.r_max) * last
    below = np.minimum(np.floor(place), last - 1).astype(np.int64)
    return below, place - below


def codes(
    points: Array,
    graph: Graph,
    layer: int,
    response: Response,
    shape: Shape,
    bins: Bins,
    depth: float,
    origin: ArrayLike = redraw.ORIGIN,
) -> Indices:
    """(M, sides, P) quantised maps of one layer at points (P, 2); layer N is the pores."""
    exponent = _exponents(layer, response, bins)
    found = []
    for r, step in zip(samples(bins), steps(bins, depth, exponent[1]), strict=True):
        width, depth_scale = scales(r, *exponent)
        elements = _elements(graph, layer, bins, width, depth_scale, origin)
        valleys, bulges = meet(points, *elements, shape)
        sides = [valleys, bulges] if bins.merge == "mellow" else [bulges - valleys]
        found.append(quantise(depth * np.stack(sides), step, bins.bits))
    return np.stack(found)


def blend(
    layers: list[Indices], r: Array, response: Response, shape: Shape, bins: Bins, depth: float
) -> Array:
    """(P,) displacement from the codes of every layer, (M, sides, P) each, and r (N + 1, P)."""
    blended = []
    for layer, maps in enumerate(layers):
        exponent = _exponents(layer, response, bins)
        decoded = maps * steps(bins, depth, exponent[1])[:, None, None]
        below, share = blend_weights(r[layer], bins)
        at = np.arange(maps.shape[-1])
        value = (1 - share) * decoded[below, :, at].T + share * decoded[below + 1, :, at].T
        factor = scales(r[layer], *exponent)[1] if bins.depth_factored else 1.0
        blended.append(value * factor)
    return merge(np.stack(blended), shape, bins, depth)


def merge(values: Array, shape: Shape, bins: Bins, depth: float) -> Array:
    """(P,) from the blended layers (N + 1, sides, P).

    The slots of the mellow-max are already in each layer's map, 1 + Σ/n, so that the merge of
    the maps adds without them: then it equals the mellow-max of all elements at once.
    """
    if bins.merge == "min":
        lowest: Array = values[:, 0].min(axis=0)
        return lowest
    valleys, bulges = mellow_max(np.moveaxis(values, 0, -1) / depth, shape.sharpness)
    return depth * (bulges - valleys)


def binned(
    points: Array,
    graph: Graph,
    log_ratios: ArrayLike,
    axes: ArrayLike,
    response: Response,
    shape: Shape,
    bins: Bins,
    depth: float,
    origin: ArrayLike = redraw.ORIGIN,
    jacobian: Array | None = None,
) -> Array:
    """(P,) displacement at texels (P, 2) with clamped log stretch (P, 2) and axes (P, 2, 2)."""
    layers = [
        codes(points, graph, layer, response, shape, bins, depth, origin)
        for layer in range(bins.count + 1)
    ]
    r = layer_stretch(log_ratios, axes, bins.count, jacobian)
    return blend(layers, r, response, shape, bins, depth)


def _exponents(layer: int, response: Response, bins: Bins) -> tuple[float, float]:
    """Exponents of width and depth of a layer."""
    if layer == bins.count:
        return response.beta_w, response.beta_d
    return response.alpha_w, response.alpha_d


def _elements(
    graph: Graph, layer: int, bins: Bins, width: Array, depth: Array, origin: ArrayLike
) -> tuple[Wrinkles | None, Pores | None]:
    if bins.depth_factored:
        depth = np.ones_like(depth)
    if layer == bins.count:
        return None, redraw.pores(graph, width, depth, origin)
    mine = assign(redraw.directions(graph), bins.count)[0] == layer
    return Wrinkles(*(a[mine] for a in redraw.wrinkles(graph, width, depth, origin))), None
