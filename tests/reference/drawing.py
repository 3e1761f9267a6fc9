"""Shapes of wrinkles and pores, and how their heights meet in a displacement map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference.boxes import PointsByU
from reference.inputs import Array, Shape
from reference.waves import Waves, wave


class Wrinkles(NamedTuple):
    """Stretch is already in: half_width = σ_w · half width, strength = weight · σ_d."""

    segments: Array  # (M, 2, 2) ends in UV
    half_width: Array  # (M,)
    strength: Array  # (M,) in units of depth
    waves: Waves | None = None  # None: all are straight
    metric: Array | None = None  # (M, 3) uu, uv, vv, in place of half_width where not 0


class Pores(NamedTuple):
    """Stretch is already in: metric = UV metric / σ_w², strength = weight · σ_d."""

    centres: Array  # (N, 2)
    metric: Array  # (N, 3) uu, uv, vv
    strength: Array  # (N,) in units of depth


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


def _straightened(
    points: Array, segment: Array, wave: Waves | None, half_width: float, metric: Array
) -> tuple[Array, Array, Waves | None, float]:
    """The same wrinkle, its wave, its size and the points in coordinates in which the metric is
    the identity, kept from being mirrored."""
    root = np.linalg.cholesky(metric[[0, 1, 1, 2]].reshape(2, 2)).T
    if wave is not None:
        wave = wave._replace(amplitude=wave.amplitude / half_width)
    return points @ root.T, segment @ root.T, wave, 1.0


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
    waves = wrinkles.waves
    reach = wrinkles.half_width if waves is None else wrinkles.half_width + np.abs(waves.amplitude)
    extent = np.repeat(reach[:, None], 2, axis=1)
    skewed = np.zeros(len(reach), bool)
    if wrinkles.metric is not None:
        skewed = (wrinkles.metric != 0).any(axis=1)
        extent[skewed] = rim_extent(wrinkles.metric[skewed])
        extent[skewed] *= (reach / wrinkles.half_width)[skewed, None]
    low = wrinkles.segments.min(axis=1) - extent
    high = wrinkles.segments.max(axis=1) + extent
    for i in strips.touched_by(low, high):
        rows = strips.within(low[i], high[i])
        at, segment, size = points[rows], wrinkles.segments[i], wrinkles.half_width[i]
        wave = None if waves is None else waves.of(i)
        if skewed[i]:
            at, segment, wave, size = _straightened(at, segment, wave, size, wrinkles.metric[i])
        if wave is None:
            distance = segment_distance(at, *segment)
        else:
            distance = wavy_distance(at, *segment, wave)
        t = distance / size
        height = -wrinkles.strength[i] * profile(t, shape.wrinkle_bulge)
        _add(sums, rows, height, shape.sharpness)


def _add_pores(sums: Array, points: Array, strips: PointsByU, pores: Pores, shape: Shape) -> None:
    extent = rim_extent(pores.metric)
    low, high = pores.centres - extent, pores.centres + extent
    for i in strips.touched_by(low, high):
        rows = strips.within(low[i], high[i])
        t = metric_distance(points[rows], pores.centres[i], pores.metric[i])
        height = -pores.strength[i] * profile(t, shape.pore_bulge)
        _add(sums, rows, height, shape.sharpness)


def _add(sums: Array, rows: np.ndarray, height: Array, sharpness: float) -> None:
    sums[0, rows] += np.expm1(sharpness * np.maximum(-height, 0))
    sums[1, rows] += np.expm1(sharpness * np.maximum(height, 0))


def _soft(total: Array, sharpness: float, slots: int) -> Array:
    return np.log1p(total / slots) / sharpness
