"""Shapes of wrinkles and pores, and how their heights meet in a displacement map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference import arcs
from reference.boxes import PointsByU
from reference.inputs import Array, Shape
from reference.waves import Waves, wave


class Wrinkles(NamedTuple):
    """Stretch is already in: half_width = σ_w · half width, strength = weight · σ_d."""

    segments: Array  # (M, 2, 2) ends in UV
    half_width: Array  # (M,), or (M, 2) at both ends
    strength: Array  # (M,) in units of depth, or (M, 2)
    waves: Waves | None = None  # None: none is wavy
    slopes: Array | None = None  # (M, 2) of arcs at both ends; None: all are straight
    least: float = 0.0  # half width below which a line is drawn that wide and shallower
    # (M, 3) uu, uv, vv: in what distances and slopes of a line are meant, UV where it is 0.
    metric: Array | None = None


class Pores(NamedTuple):
    """Stretch is already in: metric = UV metric / σ_w², strength = weight · σ_d."""

    centres: Array  # (N, 2)
    metric: Array  # (N, 3) uu, uv, vv
    strength: Array  # (N,) in units of depth
    least: float = 0.0  # radius; an axis below it is drawn that long, and the pore shallower


def texels(rows: range, columns: range, resolution: int) -> Array:
    """(rows · columns, 2) texel centres local to the UDIM, row by row; row 0 is the top."""
    u = (np.array(columns) + 0.5) / resolution
    v = 1 - (np.array(rows) + 0.5) / resolution
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def crop(row: int, column: int, height: int, width: int, resolution: int) -> Array:
    """The texel centres of `height` x `width` texels from (row, column) on."""
    return texels(range(row, row + height), range(column, column + width), resolution)


def profile(t: ArrayLike, bulge: float) -> Array:
    """(1 - t²)²(1 - b t²) for t < 1, else 0: 1 at the bottom of the furrow, negative beside it."""
    s = np.minimum(np.square(np.asarray(t, np.float64)), 1.0)
    return (1 - s) ** 2 * (1 - bulge * s)


def segment_distance(points: Array, start: Array, end: Array) -> Array:
    """(P,) distance from points (P, 2) to a segment; round ends."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * along, axis=-1)


def wavy_distance(points: Array, start: Array, end: Array, waves: Waves) -> Array:
    """(P,) distance to the point of a segment that is nearest, after that point is moved aside by
    the wave of the one wrinkle in `waves`."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    left = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    whole = share * waves.share + (waves.share < 0)
    aside = waves.amplitude * wave(whole, waves.count, waves.phase)
    return np.linalg.norm(points - start - share[:, None] * along - aside[:, None] * left, axis=-1)


def metric_distance(points: Array, centre: Array, metric: Array) -> Array:
    """(P,) length of points - centre in a metric (uu, uv, vv)."""
    du, dv = (points - centre).T
    return np.sqrt(
        np.maximum(metric[0] * du * du + 2 * metric[1] * du * dv + metric[2] * dv * dv, 0)
    )


def disc_metric(radius: ArrayLike) -> Array:
    """(N, 3) metric whose rim is the circle of `radius` (N,)."""
    inverse = 1 / np.square(np.asarray(radius, np.float64))
    return np.stack([inverse, np.zeros_like(inverse), inverse], axis=-1)


def rim_extent(metric: Array) -> Array:
    """(N, 2) how far the rims of metrics (N, 3) go along u and v."""
    uu, uv, vv = metric.T
    return np.sqrt(np.stack([vv, uu], axis=-1) / (uu * vv - uv * uv)[:, None])


def _root(metric: Array) -> Array:
    """(2, 2) that leads to coordinates in which a metric (3,) is the identity, kept from being
    mirrored."""
    root: Array = np.linalg.cholesky(metric[[0, 1, 1, 2]].reshape(2, 2)).T
    return root


def mellow_max(values: ArrayLike, sharpness: float, slots: int = 1) -> Array:
    """log(1 + Σ(e^{βx} - 1)/n)/β over the last axis; x >= 0."""
    total = np.expm1(sharpness * np.asarray(values, np.float64)).sum(-1)
    return _soft(total, sharpness, slots)


def meet(
    points: Array, wrinkles: Wrinkles | None, pores: Pores | None, shape: Shape
) -> tuple[Array, Array]:
    """Depth of the valleys and height of the bulges at points (P, 2), each (P,) >= 0, in units of
    depth: the two mellow-maxima, which must not cancel before they have met their own kind."""
    sums = np.zeros((2, len(points)))
    strips = PointsByU(points)
    if wrinkles is not None:
        _add_wrinkles(sums, points, strips, wrinkles, shape)
    if pores is not None:
        _add_pores(sums, points, strips, pores, shape)
    valleys, bulges = _soft(sums, shape.sharpness, shape.slots)
    return valleys, bulges


def draw(
    points: Array, wrinkles: Wrinkles | None, pores: Pores | None, shape: Shape, depth: float
) -> Array:
    """(P,) displacement at points (P, 2), in the unit of depth; furrows negative."""
    valleys, bulges = meet(points, wrinkles, pores, shape)
    return depth * (bulges - valleys)


def _add_wrinkles(
    sums: Array, points: Array, strips: PointsByU, wrinkles: Wrinkles, shape: Shape
) -> None:
    low, high = around(wrinkles)
    for i in strips.touched_by(low, high):
        if not np.any(wrinkles.strength[i]):
            continue
        rows = strips.within(low[i], high[i])
        share, distance = nearest(points[rows], wrinkles, i)
        half_width = arcs.between(wrinkles.half_width[i], share)
        drawn = np.maximum(half_width, wrinkles.least)
        strength = arcs.between(wrinkles.strength[i], share) * half_width / drawn
        height = -strength * profile(distance / drawn, shape.wrinkle_bulge)
        _add(sums, rows, height, shape.sharpness)


def around(wrinkles: Wrinkles) -> tuple[Array, Array]:
    """Corners (M, 2) and (M, 2) of boxes around the wrinkles."""
    widest = np.asarray(wrinkles.half_width)
    if widest.ndim == 2:
        widest = widest.max(axis=1)
    reach = np.maximum(widest, wrinkles.least)[:, None]
    if wrinkles.waves is not None:
        reach = reach + np.abs(wrinkles.waves.amplitude)[:, None]
    low, high = wrinkles.segments.min(axis=1), wrinkles.segments.max(axis=1)
    if wrinkles.slopes is not None:
        ends = zip(wrinkles.segments, wrinkles.slopes, strict=True)
        corners = [arcs.box(*segment, slopes) for segment, slopes in ends]
        low, high = np.reshape(corners, (-1, 2, 2)).swapaxes(0, 1)
    low, high = low - reach, high + reach
    for i in _skewed(wrinkles):
        low[i], high[i] = _skewed_box(wrinkles, i, reach[i])
    return low, high


def _skewed(wrinkles: Wrinkles) -> Array:
    """Those with a metric."""
    if wrinkles.metric is None:
        return np.zeros(0, int)
    return np.flatnonzero((wrinkles.metric != 0).any(axis=1))


def _skewed_box(wrinkles: Wrinkles, i: int, reach: Array) -> tuple[Array, Array]:
    """Corners of a box around wrinkle i, which is `reach` (1,) wide in its metric: what goes out to
    where it is a box there."""
    root = _root(wrinkles.metric[i])
    ends = wrinkles.segments[i] @ root.T
    low, high = ends.min(axis=0), ends.max(axis=0)
    if wrinkles.slopes is not None:
        low, high = arcs.box(*ends, wrinkles.slopes[i])
    x, y = np.stack([low - reach, high + reach], axis=1)
    corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) @ np.linalg.inv(root).T
    return corners.min(axis=0), corners.max(axis=0)


def nearest(points: Array, wrinkles: Wrinkles, i: int) -> tuple[Array, Array]:
    """Where along wrinkle i (P,), 0 to 1, and the distance (P,) there."""
    segment, waves = wrinkles.segments[i], wrinkles.waves
    if wrinkles.metric is not None and wrinkles.metric[i].any():
        root = _root(wrinkles.metric[i])
        points, segment = points @ root.T, segment @ root.T
    if wrinkles.slopes is not None:
        share, distance = arcs.nearest(points, *segment, wrinkles.slopes[i])
        if waves is None:
            return share, distance
        return share, _from_arc(points, segment, wrinkles.slopes[i], share, waves.of(i))
    along = segment[1] - segment[0]
    share = np.clip((points - segment[0]) @ along / (along @ along), 0.0, 1.0)
    if waves is None:
        return share, segment_distance(points, *segment)
    return share, wavy_distance(points, *segment, waves.of(i))


def _from_arc(points: Array, segment: Array, slopes: Array, share: Array, waves: Waves) -> Array:
    """(P,) distance from the places `share` (P,) of an arc after they are moved aside by its wave,
    across the line from end to end."""
    along = segment[1] - segment[0]
    length = np.linalg.norm(along)
    left = np.array([-along[1], along[0]]) / length
    whole = share * waves.share + (waves.share < 0)
    aside = waves.amplitude * wave(whole, waves.count, waves.phase, level=True)
    aside = aside + length * arcs.offset(share, slopes)
    moved = segment[0] + share[:, None] * along + aside[:, None] * left
    return np.linalg.norm(points - moved, axis=-1)


def _add_pores(sums: Array, points: Array, strips: PointsByU, pores: Pores, shape: Shape) -> None:
    metrics, strength = at_least(pores)
    extent = rim_extent(metrics)
    low, high = pores.centres - extent, pores.centres + extent
    for i in strips.touched_by(low, high):
        rows = strips.within(low[i], high[i])
        t = metric_distance(points[rows], pores.centres[i], metrics[i])
        height = -strength[i] * profile(t, shape.pore_bulge)
        _add(sums, rows, height, shape.sharpness)


def at_least(pores: Pores) -> tuple[Array, Array]:
    """Metrics (N, 3) and strengths (N,): no axis of a pore below the least radius, its mean as it
    was."""
    if pores.least == 0.0:
        return pores.metric, pores.strength
    uu, uv, vv = pores.metric.T
    values, axes = np.linalg.eigh(np.stack([uu, uv, uv, vv], axis=-1).reshape(-1, 2, 2))
    radii = values**-0.5
    drawn = np.maximum(radii, pores.least)
    made = np.einsum("nik,nk,njk->nij", axes, drawn**-2.0, axes)
    strength = pores.strength * radii.prod(axis=-1) / drawn.prod(axis=-1)
    return np.stack([made[:, 0, 0], made[:, 0, 1], made[:, 1, 1]], axis=-1), strength


def _add(sums: Array, rows: np.ndarray, height: Array, sharpness: float) -> None:
    sums[0, rows] += np.expm1(sharpness * np.maximum(-height, 0))
    sums[1, rows] += np.expm1(sharpness * np.maximum(height, 0))


def _soft(total: Array, sharpness: float, slots: int) -> Array:
    return np.log1p(total / slots) / sharpness
