"""Wrinkles and pores of one UDIM, laid out for drawing: texel units, sorted, listed by block."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.tiles import udim_origin
from rhytid.errors import LimitError
from rhytid.pipeline.cells import CellLists, list_by_cell
from rhytid.pipeline.copies import (
    OriginBuffers,
    Origins,
    copied,
    copies_last,
    metric_roots,
    rim_reach,
    skewed_roots,
)

BLOCK = 64
# σ_w and σ_d are kept in [1/SCALE_LIMIT, SCALE_LIMIT].
SCALE_LIMIT = 4.0
# What response.clh takes of this page.
RESPONSE_DEFINES = {"SCALE_LIMIT": f"{SCALE_LIMIT}f"}
# Texels that may be covered for each texel of the map, all elements together.
_MOST_COVER = 4096.0
_MARGIN = 1.001  # beyond the rounding of the scales on the device


@dataclass(frozen=True)
class WrinkleArrays:
    """K wrinkles of a UDIM in texels, v up: segments (K, 4) = start and extent, sizes (K, 2) =
    half width and weight, triangle (K,) that each samples, lists by block, stiffness (K,) or
    None: 1 throughout. waves (K, 4) as in wave.clh, or None where all are straight.

    The last of them may be copies, and wrinkles with a metric: skews (S, 4) are the roots (xx, xy,
    yy, 0) of theirs, and origins what they answer to stretch with."""

    segments: NDArray[np.float32]
    sizes: NDArray[np.float32]
    triangle: NDArray[np.int32]
    lists: CellLists
    stiffness: NDArray[np.float32] | None = None
    waves: NDArray[np.float32] | None = None
    skews: NDArray[np.float32] | None = None
    origins: Origins | None = None


@dataclass(frozen=True)
class PoreArrays:
    """K pores of a UDIM in texels, v up: centres (K, 2), roots (K, 4) = (xx, xy, yy, weight),
    triangle (K,) that each samples, lists by block. The rim is where |root·d| = 1 with
    root = [[xx, xy], [0, yy]]. stiffness (K,) or None: 1 throughout. The last of them may be
    copies; origins is what these answer to stretch with."""

    centres: NDArray[np.float32]
    roots: NDArray[np.float32]
    triangle: NDArray[np.int32]
    lists: CellLists
    stiffness: NDArray[np.float32] | None = None
    origins: Origins | None = None


def widest(exponent: float, log_stretch_limit: float) -> float:
    """The largest width scale that a log stretch within the limit can give."""
    return _MARGIN * min(math.exp(exponent * log_stretch_limit), SCALE_LIMIT)


def wrinkle_arrays(
    graph: WrinkleGraph,
    triangle: NDArray[np.int32],
    settings: AssetSettings,
    udim: int,
    stiffness: NDArray[np.float32] | None = None,
    waves: NDArray[np.float32] | None = None,
) -> WrinkleArrays:
    """Those wrinkles of strength above 0 that reach into the UDIM at any stretch.

    triangle, stiffness: (M,) of every wrinkle of the graph.  waves: (M, 4) what `wrinkle_waves`
    makes of the settings.
    """
    ends = (graph.node_uv - np.array(udim_origin(udim), np.float32))[graph.edge_nodes]
    low, high = _around_wrinkles(graph, ends, settings, waves)
    last = copied(graph.edge_copy_of, graph.edge_metric)
    chosen, first = copies_last(_chosen(graph.edge_weight, low, high), last)
    _check_cover(low[chosen], high[chosen], settings.resolution, "wrinkles", udim)
    size, tail = np.float32(settings.resolution), chosen[first:]

    def segments(rows: NDArray[np.int64]) -> NDArray[np.float32]:
        start, stop = ends[rows, 0].astype(np.float64), ends[rows, 1].astype(np.float64)
        extent = ((stop - start) * size).astype(np.float32)
        return np.concatenate([ends[rows, 0] * size, extent], axis=1)

    return WrinkleArrays(
        segments(chosen),
        np.stack([graph.edge_half_width[chosen] * size, graph.edge_weight[chosen]], axis=1),
        triangle[chosen],
        _blocks(low[chosen], high[chosen], settings.resolution),
        None if stiffness is None else stiffness[chosen],
        None if waves is None else waves[chosen] * np.array([size, 1, 1, 1], np.float32),
        skewed_roots(graph, tail, settings.resolution) if len(tail) else None,
        Origins.of(tail, graph.edge_copy_of, segments, triangle, stiffness),
    )


def pore_arrays(
    graph: WrinkleGraph,
    triangle: NDArray[np.int32],
    settings: AssetSettings,
    udim: int,
    stiffness: NDArray[np.float32] | None = None,
) -> PoreArrays:
    """Those pores of strength above 0 that reach into the UDIM at any stretch.

    triangle, stiffness: (N,) of every pore of the graph.
    """
    centres = graph.node_uv - np.array(udim_origin(udim), np.float32)
    root = _roots(graph)
    low, high = _around_pores(centres, root, settings)
    chosen, first = copies_last(
        _chosen(graph.node_weight, low, high), copied(graph.node_copy_of, None)
    )
    _check_cover(low[chosen], high[chosen], settings.resolution, "pores", udim)
    size = np.float32(settings.resolution)
    in_texels = root[chosen] / float(settings.resolution)
    weight = graph.node_weight[chosen, None]
    return PoreArrays(
        centres[chosen] * size,
        np.concatenate([in_texels, weight], axis=1).astype(np.float32),
        triangle[chosen],
        _blocks(low[chosen], high[chosen], settings.resolution),
        None if stiffness is None else stiffness[chosen],
        Origins.of(
            chosen[first:],
            graph.node_copy_of,
            lambda rows: centres[rows] * size,
            triangle,
            stiffness,
        ),
    )


def check_cover(graph: WrinkleGraph, settings: AssetSettings, udim: int) -> None:
    """Raise LimitError where `wrinkle_arrays` or `pore_arrays` would, for what they cover; of
    straight wrinkles, for how far waves reach is known only where the wrinkles are located."""
    local = graph.node_uv - np.array(udim_origin(udim), np.float32)
    around = (
        ("wrinkles", graph.edge_weight, _around_wrinkles(graph, local[graph.edge_nodes], settings)),
        ("pores", graph.node_weight, _around_pores(local, _roots(graph), settings)),
    )
    for what, weight, (low, high) in around:
        inside = _reaching_in(weight, low, high)
        _check_cover(low[inside], high[inside], settings.resolution, f"graph's {what}", udim)


def orientation_bins(segments: NDArray[np.float32], count: int) -> NDArray[np.uint8]:
    """The bin of each wrinkle (section 2.4): nearest, mod π, to θₙ = (sin(πn/N), cos(πn/N))."""
    angle = np.arctan2(segments[:, 2].astype(np.float64), segments[:, 3].astype(np.float64))
    return (np.rint(angle * (count / np.pi)).astype(np.int64) % count).astype(np.uint8)


@dataclass(frozen=True)
class Lists:
    """Block lists on the device."""

    offsets: Buffer
    members: Buffer

    @classmethod
    def upload(cls, device: Device, lists: CellLists) -> Lists:
        """The lists, on the device."""
        return cls(device.upload(lists.offsets), device.upload(lists.members))


class UdimElements:
    """The wrinkles and pores of one UDIM on the device."""

    def __init__(
        self, device: Device, wrinkles: WrinkleArrays, pores: PoreArrays, bin_count: int
    ) -> None:
        self.wrinkles, self.pores = len(wrinkles.segments), len(pores.centres)
        self.segments = device.upload(wrinkles.segments)
        self.sizes = device.upload(wrinkles.sizes)
        self.bins = device.upload(orientation_bins(wrinkles.segments, bin_count))
        self.wrinkle_triangle = device.upload(wrinkles.triangle)
        self.wrinkle_stiffness = _upload(device, wrinkles.stiffness)
        self.wrinkle_lists = Lists.upload(device, wrinkles.lists)
        self.waves = _upload(device, wrinkles.waves)
        self.skews = _upload(device, wrinkles.skews)
        self._even = self.wrinkles - (0 if wrinkles.skews is None else len(wrinkles.skews))
        self.wrinkle_origins = OriginBuffers.upload(device, wrinkles.origins, self.wrinkles)
        self.centres = device.upload(pores.centres)
        self.roots = device.upload(pores.roots)
        self.pore_triangle = device.upload(pores.triangle)
        self.pore_stiffness = _upload(device, pores.stiffness)
        self.pore_lists = Lists.upload(device, pores.lists)
        self.pore_origins = OriginBuffers.upload(device, pores.origins, self.pores)

    @property
    def wrinkle_arguments(self) -> tuple[Any, ...]:
        """What drawing kernels take of waves and skews, last of their elements."""
        waves = () if self.waves is None else (self.waves,)
        return waves if self.skews is None else (*waves, np.int32(self._even), self.skews)

    @property
    def defines(self) -> dict[str, object]:
        """What drawing kernels are compiled with for these."""
        found = {"WAVY": self.waves, "SKEWED": self.skews}
        return {name: 1 for name, buffer in found.items() if buffer is not None}

    def release(self) -> None:
        """Give the memory back."""
        for value in vars(self).values():
            if isinstance(value, Lists):
                value.offsets.release()
                value.members.release()
            elif isinstance(value, Buffer | OriginBuffers):
                value.release()


def _upload(device: Device, array: NDArray[np.float32] | None) -> Buffer | None:
    return None if array is None else device.upload(array)


def _around_wrinkles(
    graph: WrinkleGraph,
    ends: NDArray[np.float32],
    settings: AssetSettings,
    waves: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (M, 2) and (M, 2) of the boxes around wrinkles of ends (M, 2, 2) at any stretch."""
    response = settings.response
    scale = widest(response.alpha_w, response.log_stretch_limit)
    reach = (graph.edge_half_width * scale)[:, None]
    if waves is not None:
        reach = reach + np.abs(waves[:, :1])
    if graph.edge_metric is not None:
        rows = np.flatnonzero(graph.edge_metric.any(axis=1))
        wider = reach[rows] / graph.edge_half_width[rows, None]
        reach = np.repeat(reach, 2, axis=1)
        reach[rows] = wider * rim_reach(metric_roots(graph.edge_metric[rows]))
    return ends.min(axis=1) - reach, ends.max(axis=1) + reach


def _around_pores(
    centres: NDArray[np.float32], root: NDArray[np.float64], settings: AssetSettings
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (N, 2) and (N, 2) of the boxes around pores at any stretch."""
    response = settings.response
    reach = rim_reach(root) * widest(response.beta_w, response.log_stretch_limit)
    return centres - reach, centres + reach


def _roots(graph: WrinkleGraph) -> NDArray[np.float64]:
    """(N, 3) Cholesky factors (xx, xy, yy) of the metrics, UV units: rootᵀ·root = metric."""
    if graph.node_metric is None:
        across = 1.0 / graph.node_radius.astype(np.float64)
        return np.stack([across, np.zeros_like(across), across], axis=1)
    return metric_roots(graph.node_metric)


def _chosen(
    weight: NDArray[np.float32], low: NDArray[np.floating], high: NDArray[np.floating]
) -> NDArray[np.int64]:
    """Indices of what is drawn, sorted by the block of the centre for locality of memory."""
    members = np.flatnonzero(_reaching_in(weight, low, high))
    cell = np.clip((low[members] + high[members]) * 128.0, 0, 255).astype(np.int64)
    return members[np.argsort(cell[:, 1] * 256 + cell[:, 0], kind="stable")]


def _reaching_in(
    weight: NDArray[np.float32], low: NDArray[np.floating], high: NDArray[np.floating]
) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (weight > 0) & (high > 0).all(axis=1) & (low < 1).all(axis=1)
    return inside


def _blocks(low: NDArray[np.floating], high: NDArray[np.floating], resolution: int) -> CellLists:
    texel = 1.0 / resolution
    return list_by_cell(low - texel, high + texel, resolution // BLOCK, top_down=True)


def _check_cover(
    low: NDArray[np.floating], high: NDArray[np.floating], resolution: int, what: str, udim: int
) -> None:
    size = np.minimum(high, 1.0) - np.maximum(low, 0.0)
    cover = float(np.prod(size, axis=1, dtype=np.float64).sum())
    if cover > _MOST_COVER:
        raise LimitError(
            f"the {what} cover {cover:.0f} times the map of UDIM {udim} at their widest: "
            f"more than {_MOST_COVER:.0f} (at {resolution}² texels)"
        )
