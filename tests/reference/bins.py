"""The fast method: maps drawn ahead by angle and stretch, blended by texel (section 2.4, Alg. 3).

A layer is one bin of wrinkles or, last, the pores. A layer has one map a stretch sample, or two,
valleys and bulges (`mellow`): the `side` axis below. With `tilt` a bin of wrinkles has one more
map, of where between its edges in angle the wrinkle at a point runs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference import redraw
from reference.drawing import Pores, Wrinkles, meet, mellow_max
from reference.inputs import Array, Bins, Graph, Indices, Response, Shape
from reference.response import WIDEST, on_surface, pore_stretch, scales, wrinkle_stretch
from reference.waves import Waves

HEADROOM = 0.2
TILT_SHARE = 0.25
TILT_NODE = 0.6


def angles(count: int) -> Array:
    """(N,) αₙ = πn/N."""
    return np.pi * np.arange(count) / count


def directions(count: int, turn: float = 0.0) -> Array:
    """(N, 2) θₙ = (sin αₙ, cos αₙ): n = 0 runs along v, north to south.  turn: in half bins."""
    turned = angles(count) + turn * np.pi / (2 * count)
    return np.stack([np.sin(turned), np.cos(turned)], axis=-1)


def last_sample(bins: Bins) -> float:
    """Log stretch of the outer samples."""
    return bins.reach * bins.r_max


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
    return np.linspace(-last_sample(bins), last_sample(bins), bins.samples)


def of_layer(layer: int, bins: Bins) -> Bins:
    """With the samples of that layer: pores may have more or fewer than the bins."""
    if layer < bins.count or bins.pore_samples is None:
        return bins
    return replace(bins, samples=bins.pore_samples)


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
    log_ratios: ArrayLike,
    axes: ArrayLike,
    count: int,
    jacobian: Array | None = None,
    turn: float = 0.0,
) -> Array:
    """(N + 1, ...) r of every layer: Alg. 1 with θₙ (one bin: the mean), then Alg. 2 for pores.

    log_ratios: (..., 2), clamped to the limit of log stretch, not to r_max.  axes: (..., 2, 2).
    jacobian: (..., 2, 2), to take angles on the surface.  turn: of all θₙ, in half bins.
    """
    mean = pore_stretch(log_ratios)
    if count == 1:
        return np.stack([mean, mean])
    thetas = [*directions(count, turn)]
    if jacobian is not None:
        axes = on_surface(jacobian[..., None, :, :], axes)
        thetas = [on_surface(jacobian, theta) for theta in thetas]
    bins = [wrinkle_stretch(log_ratios, axes, theta) for theta in thetas]
    return np.stack([*bins, mean])


def blend_weights(r: ArrayLike, bins: Bins) -> tuple[Indices, Array]:
    """The sample below r, clamped to the outer ones, and the share (0 to 1) of the next above."""
    last = bins.samples - 1
    most = last_sample(bins)
    place = (np.clip(np.asarray(r, np.float64), -most, most) + most) / (2 * most) * last
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
    waves: Waves | None = None,
) -> Indices:
    """(M, sides, P) quantised maps of one layer at points (P, 2); layer N is the pores."""
    exponent, own = _exponents(layer, response, bins), of_layer(layer, bins)
    found = []
    for r, step in zip(samples(own), steps(own, depth, exponent[1]), strict=True):
        width, depth_scale = scales(r, *exponent)
        elements = _elements(graph, layer, bins, width, depth_scale, origin, waves)
        valleys, bulges = meet(points, *elements, shape)
        sides = [valleys, bulges] if bins.merge == "mellow" else [bulges - valleys]
        found.append(quantise(depth * np.stack(sides), step, bins.bits))
    return np.stack(found)


def tilts(
    points: Array,
    graph: Graph,
    layer: int,
    response: Response,
    shape: Shape,
    bins: Bins,
    origin: ArrayLike = redraw.ORIGIN,
) -> Array:
    """(P,) where in its bin the wrinkle at each point runs, from edge to edge -1 to 1.

    From the heights of wrinkles whose strengths are scaled by 1 + s·x and by 1 - s·x, x where each
    runs: (up - down)/(s·(up + down)). Of a lone wrinkle it is its x.
    """
    width, depth_scale = scales(last_sample(bins), response.alpha_w, 0.0)
    wrinkles, _ = _elements(graph, layer, bins, width, depth_scale, origin)
    assert wrinkles is not None
    along = wrinkles.segments[:, 1] - wrinkles.segments[:, 0]
    turn = (np.arctan2(along[:, 0], along[:, 1]) - angles(bins.count)[layer]) / np.pi
    x = (turn - np.rint(turn)) * 2 * bins.count
    heights = []
    for share in (TILT_SHARE, -TILT_SHARE):
        scaled = wrinkles._replace(strength=wrinkles.strength * (1 + share * x))
        valleys, bulges = meet(points, scaled, None, shape)
        heights.append(bulges - valleys)
    up, down = heights
    total = np.where(up + down == 0, 1.0, up + down)
    return np.clip((up - down) / (TILT_SHARE * total), -1, 1)


def tilted_depth(tilt: Array, low: Array, high: Array) -> Array:
    """σ_d at a tilt: the line through its values TILT_NODE to either side of the bin's middle,
    kept within 0 and 4 over the whole bin."""
    middle = (low + high) / 2
    rise = (high - low) / (2 * TILT_NODE * middle)
    most = np.minimum(1.0, WIDEST / middle - 1.0)
    found: Array = middle * (1 + np.clip(rise, -most, most) * tilt)
    return found


class Tilts(NamedTuple):
    """What blending with tilts adds: codes (N, P); r (N + 1, P) with all θ turned by -TILT_NODE
    and by TILT_NODE half bins."""

    codes: Indices
    low: Array
    high: Array


def blend(
    layers: list[Indices],
    r: Array,
    response: Response,
    shape: Shape,
    bins: Bins,
    depth: float,
    tilted: Tilts | None = None,
) -> Array:
    """(P,) displacement from the codes of every layer, (M, sides, P) each, and r (N + 1, P)."""
    blended = []
    for layer, maps in enumerate(layers):
        exponent, own = _exponents(layer, response, bins), of_layer(layer, bins)
        decoded = maps * steps(own, depth, exponent[1])[:, None, None]
        below, share = blend_weights(r[layer], own)
        at = np.arange(maps.shape[-1])
        value = (1 - share) * decoded[below, :, at].T + share * decoded[below + 1, :, at].T
        factor = scales(r[layer], *exponent)[1] if bins.depth_factored else 1.0
        if tilted is not None and layer < bins.count > 1:
            ends = (scales(side[layer], *exponent)[1] for side in (tilted.low, tilted.high))
            factor = tilted_depth(tilted.codes[layer] / (2 ** (bins.bits - 1) - 1), *ends)
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
    if bins.merge == "soft":
        return depth * soft(values[:, 0] / depth, shape.sharpness)
    if bins.merge == "signed":
        values = np.maximum(np.stack([-values[:, 0], values[:, 0]], axis=1), 0.0)
    valleys, bulges = mellow_max(np.moveaxis(values, 0, -1) / depth, shape.sharpness)
    return depth * (bulges - valleys)


def soft(heights: Array, sharpness: float) -> Array:
    """(P,) the highest bulge less the two deepest valleys a >= b of heights (K, P): they come to
    a + min(b, (w - (a - b))²/4w), the square only within w = 4 log(2)/β of one another."""
    valleys = np.sort(np.maximum(-heights, 0.0), axis=0)
    a, b = valleys[-1], valleys[-2] if len(valleys) > 1 else 0.0
    w = 4 * np.log(2.0) / sharpness
    near = np.maximum(w - (a - b), 0.0)
    found: Array = np.maximum(heights, 0.0).max(axis=0) - a - np.minimum(b, near**2 / (4 * w))
    return found


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


def sides_of(
    log_ratios: ArrayLike, axes: ArrayLike, count: int, jacobian: Array | None = None
) -> tuple[Array, Array]:
    """r (N + 1, ...) to either side of the middle of each bin, for `Tilts`."""
    low, high = (
        layer_stretch(log_ratios, axes, count, jacobian, turn) for turn in (-TILT_NODE, TILT_NODE)
    )
    return low, high


def _exponents(layer: int, response: Response, bins: Bins) -> tuple[float, float]:
    """Exponents of width and depth of a layer."""
    if layer == bins.count:
        return response.beta_w, response.beta_d
    return response.alpha_w, response.alpha_d


def _elements(
    graph: Graph,
    layer: int,
    bins: Bins,
    width: Array,
    depth: Array,
    origin: ArrayLike,
    waves: Waves | None = None,
) -> tuple[Wrinkles | None, Pores | None]:
    if bins.depth_factored:
        depth = np.ones_like(depth)
    if layer == bins.count:
        return None, redraw.pores(graph, width, depth, origin)
    mine = assign(redraw.directions(graph), bins.count)[0] == layer
    whole = redraw.wrinkles(graph, width, depth, origin)
    own = None if waves is None else Waves(*(values[mine] for values in waves))
    return Wrinkles(*(values[mine] for values in whole[:3]), own), None
