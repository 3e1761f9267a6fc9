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
from rhytid.pipeline.bends import Bends, arc_box, bends_of, straight_box
from rhytid.pipeline.cells import CellLists, list_by_cell
from rhytid.pipeline.copies import (
    OriginBuffers,
    Origins,
    copied,
    copies_last,
    metric_roots,
    rim_reach,
    skews_of,
)
from rhytid.pipeline.cushion_elements import (
    APRON,
    LEAST_HALF_WIDTH,
    CushionArrays,
    broad_weight,
    coarse_factor,
    cushion_lists,
    narrow_weight,
)

BLOCK = 64
# σ_w and σ_d are kept in [1/SCALE_LIMIT, SCALE_LIMIT].
SCALE_LIMIT = 4.0
# Texels that may be covered for each texel of the map, all elements together.
_MOST_COVER = 4096.0
_MARGIN = 1.001  # beyond the rounding of the scales on the device


@dataclass(frozen=True)
class WrinkleArrays:
    """K wrinkles of a UDIM in texels, v up: segments (K, 4) = start and extent, sizes (K, 2) =
    half width and weight, triangle (K,) that each samples, lists by block, stiffness (K,) or
    None: 1 throughout. waves (K, 4) as in wave.clh, or None where none is wavy.

    Where they bend or taper slopes is (K, 2), else None, and sizes (K, 4): half widths at both
    ends, then weights. partners (K, 2) int32: who goes on at either end, -1 for none, or None:
    nobody. Those partners that do not reach into the UDIM come last and are in no list.

    Before these may come copies, and wrinkles with a metric: skews (S, 4) are theirs as in
    line.clh, origins what they answer to stretch with, and even how many wrinkles come before
    them.

    cushion: their broad layer, beside which these are the narrow one, or None: there is none."""

    segments: NDArray[np.float32]
    sizes: NDArray[np.float32]
    triangle: NDArray[np.int32]
    lists: CellLists
    stiffness: NDArray[np.float32] | None = None
    waves: NDArray[np.float32] | None = None
    slopes: NDArray[np.float32] | None = None
    partners: NDArray[np.int32] | None = None
    skews: NDArray[np.float32] | None = None
    origins: Origins | None = None
    even: int = 0
    cushion: CushionArrays | None = None


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

    @property
    def copies(self) -> int:
        """How many of them have origins."""
        return 0 if self.origins is None else len(self.origins.triangle)


def response_defines(soft_limits: bool) -> dict[str, object]:
    """What response.clh takes."""
    soft = {"SOFT_LIMITS": 1} if soft_limits else {}
    return {"SCALE_LIMIT": f"{SCALE_LIMIT}f", **soft}


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
    bends = bends_of(graph, settings)
    low, high = _around_wrinkles(graph, ends, settings, bends, waves)
    broad = _Broad.of(graph, ends, settings, bends, waves)
    reach = (low, high) if broad is None else broad.reach(low, high)
    last = copied(graph.edge_copy_of, graph.edge_metric)
    drawn, even = copies_last(_chosen(graph.edge_weight, *reach), last)
    _check_cover(low[drawn], high[drawn], settings.resolution, "wrinkles", udim)
    chosen, partners = _with_partners(drawn, None if bends is None else bends.partners)
    size, tail = np.float32(settings.resolution), drawn[even:]

    def segments(rows: NDArray[np.int64]) -> NDArray[np.float32]:
        start, stop = ends[rows, 0].astype(np.float64), ends[rows, 1].astype(np.float64)
        extent = ((stop - start) * size).astype(np.float32)
        return np.concatenate([ends[rows, 0] * size, extent], axis=1)

    return WrinkleArrays(
        segments(chosen),
        _sizes(graph, bends, chosen, settings),
        triangle[chosen],
        _blocks(low[drawn], high[drawn], settings.resolution),
        None if stiffness is None else stiffness[chosen],
        None if waves is None else waves[chosen] * np.array([size, 1, 1, 1], np.float32),
        None if bends is None else bends.slopes[chosen],
        partners,
        skews_of(graph, tail) if len(tail) else None,
        Origins.of(tail, graph.edge_copy_of, segments, triangle, stiffness),
        even,
        None if broad is None else broad.arrays(chosen, len(drawn), udim),
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
    ends = local[graph.edge_nodes]
    bends = bends_of(graph, settings)
    if (broad := _Broad.of(graph, ends, settings, bends)) is not None:
        broad.check(_reaching_in(broad.swells, broad.low, broad.high), udim)
    around = (
        ("wrinkles", graph.edge_weight, _around_wrinkles(graph, ends, settings, bends)),
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

    def release(self) -> None:
        """Give the memory back."""
        self.offsets.release()
        self.members.release()


@dataclass(frozen=True)
class CushionElements:
    """CushionArrays on the device."""

    factor: int
    sizes: Buffer
    lists: Lists

    @classmethod
    def upload(cls, device: Device, arrays: CushionArrays | None) -> CushionElements | None:
        """The arrays, on the device."""
        if arrays is None:
            return None
        return cls(arrays.factor, device.upload(arrays.sizes), Lists.upload(device, arrays.lists))

    def release(self) -> None:
        """Give the memory back."""
        self.sizes.release()
        self.lists.release()


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
        self.slopes = _upload(device, wrinkles.slopes)
        self.partners = _upload(device, wrinkles.partners)
        self.skews = _upload(device, wrinkles.skews)
        self._even = wrinkles.even
        self.wrinkle_origins = OriginBuffers.upload(device, wrinkles.origins, wrinkles.even)
        self.cushion = CushionElements.upload(device, wrinkles.cushion)
        self.centres = device.upload(pores.centres)
        self.roots = device.upload(pores.roots)
        self.pore_triangle = device.upload(pores.triangle)
        self.pore_stiffness = _upload(device, pores.stiffness)
        self.pore_lists = Lists.upload(device, pores.lists)
        self.pore_origins = OriginBuffers.upload(device, pores.origins, self.pores - pores.copies)

    @property
    def bent(self) -> bool:
        """Whether wrinkles have sizes and scales for each of their ends."""
        return self.slopes is not None

    @property
    def response_defines(self) -> dict[str, object]:
        """What the kernels that find r of wrinkles are compiled with for these."""
        return {"BENT": 1} if self.bent else {}

    @property
    def line_arguments(self) -> tuple[Any, ...]:
        """LINES of line.clh."""
        given = (self.segments, self.sizes, self.slopes, self.waves)
        found = tuple(buffer for buffer in given if buffer is not None)
        return found if self.skews is None else (*found, np.int32(self._even), self.skews)

    @property
    def line_defines(self) -> dict[str, object]:
        """What line.clh is compiled with for these wrinkles."""
        given = {"BENT": self.slopes, "WAVY": self.waves, "SKEWED": self.skews}
        return {name: 1 for name, buffer in given.items() if buffer is not None}

    def release(self) -> None:
        """Give the memory back."""
        for value in vars(self).values():
            if isinstance(value, Lists | CushionElements | Buffer | OriginBuffers):
                value.release()


@dataclass(frozen=True)
class _Broad:
    """The broad layer of every wrinkle of the graph. weights: (M, 1), or (M, 2) where there are
    bends, at both ends; 0 where it swells nothing. low, high: (M, 2) corners of the boxes around
    what is drawn of it at any stretch."""

    graph: WrinkleGraph
    settings: AssetSettings
    bends: Bends | None
    factor: int
    weights: NDArray[np.float32]
    low: NDArray[np.floating]
    high: NDArray[np.floating]

    @classmethod
    def of(
        cls,
        graph: WrinkleGraph,
        ends: NDArray[np.float32],
        settings: AssetSettings,
        bends: Bends | None,
        waves: NDArray[np.float32] | None = None,
    ) -> _Broad | None:
        """None where no cushion is wanted."""
        if settings.shape.cushion == 0.0:
            return None
        factor = coarse_factor(graph, settings)
        least = LEAST_HALF_WIDTH * factor / settings.resolution
        broader = settings.shape.cushion_width
        low, high = _around_wrinkles(graph, ends, settings, bends, waves, broader, least)
        weights = broad_weight(_of_ends(graph, bends)[1], settings.shape)
        return cls(graph, settings, bends, factor, weights, low, high)

    @property
    def swells(self) -> NDArray[np.bool_]:
        """(M,) whether there is anything of a wrinkle in the layer."""
        found: NDArray[np.bool_] = self.weights.max(axis=1) > 0
        return found

    def reach(
        self, low: NDArray[np.floating], high: NDArray[np.floating]
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Boxes of both layers, with what the spline reads of the broad one beyond a border."""
        swells = self.swells[:, None]
        margin = (APRON + 1) * self.factor / self.settings.resolution
        return (
            np.where(swells, np.minimum(self.low - margin, low), low),
            np.where(swells, np.maximum(self.high + margin, high), high),
        )

    def check(self, inside: NDArray[np.integer] | NDArray[np.bool_], udim: int) -> None:
        """Raise LimitError where those of these indices cover too much."""
        texels = self.settings.resolution // self.factor
        _check_cover(self.low[inside], self.high[inside], texels, "cushions", udim, self.factor)

    def arrays(self, chosen: NDArray[np.int64], drawn: int, udim: int) -> CushionArrays:
        """Those of the wrinkles with these indices, of which the first `drawn` are listed."""
        listed = chosen[:drawn]
        swells, low, high = self.swells[listed], self.low[listed], self.high[listed]
        self.check(listed[swells], udim)
        nowhere = np.where(swells, 0.0, np.inf)[:, None]  # a box that is in no block
        texels = self.settings.resolution / self.factor * self.settings.shape.cushion_width
        widths = _of_ends(self.graph, self.bends)[0][chosen] * np.float32(texels)
        lists = cushion_lists(low + nowhere, high - nowhere, self.settings, self.factor)
        sizes = np.concatenate([widths, self.weights[chosen]], axis=1)
        return CushionArrays(self.factor, sizes, lists)


def _upload(device: Device, array: NDArray[Any] | None) -> Buffer | None:
    return None if array is None else device.upload(array)


def _around_wrinkles(
    graph: WrinkleGraph,
    ends: NDArray[np.float32],
    settings: AssetSettings,
    bends: Bends | None,
    waves: NDArray[np.float32] | None = None,
    broader: float = 1.0,
    least: float = 0.0,
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (M, 2) and (M, 2) of the boxes around wrinkles of ends (M, 2, 2) at any stretch.

    broader: than the graph has them.  least: half width, in UV.
    """
    response = settings.response
    scale = widest(response.alpha_w, response.log_stretch_limit)
    half_width = graph.edge_half_width if bends is None else bends.half_widths.max(axis=1)
    reach = np.maximum(half_width * (scale * broader), max(least, _least(settings)))[:, None]
    if waves is not None:
        reach = reach + np.abs(waves[:, :1])
    low, high = _boxes(graph, ends, bends)
    if graph.edge_metric is None:
        return low - reach, high + reach
    rows = np.flatnonzero(graph.edge_metric.any(axis=1))
    wider = reach[rows] / graph.edge_half_width[rows, None]
    reach = np.repeat(reach, 2, axis=1)
    reach[rows] = wider * rim_reach(metric_roots(graph.edge_metric[rows]))
    return low - reach, high + reach


def _boxes(
    graph: WrinkleGraph, ends: NDArray[np.float32], bends: Bends | None
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (M, 2) and (M, 2) of the boxes around lines without their width."""
    if bends is None:
        return straight_box(ends)
    low, high = arc_box(ends, bends.slopes)
    if graph.edge_metric is not None:
        rows = np.flatnonzero(graph.edge_metric.any(axis=1))
        roots = metric_roots(graph.edge_metric[rows])
        low[rows], high[rows] = arc_box(ends[rows], bends.slopes[rows], roots)
    return low, high


def _sizes(
    graph: WrinkleGraph, bends: Bends | None, chosen: NDArray[np.int64], settings: AssetSettings
) -> NDArray[np.float32]:
    """(K, 2) or, where there are bends, (K, 4), as WrinkleArrays has them."""
    half_widths, weights = (values[chosen] for values in _of_ends(graph, bends))
    texels = np.float32(settings.resolution)
    return np.concatenate([half_widths * texels, narrow_weight(weights, settings.shape)], axis=1)


def _of_ends(
    graph: WrinkleGraph, bends: Bends | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Half widths and weights, (M, 1), or (M, 2) at both ends where there are bends."""
    if bends is None:
        return graph.edge_half_width[:, None], graph.edge_weight[:, None]
    return bends.half_widths, bends.weights


def _with_partners(
    drawn: NDArray[np.int64], partners: NDArray[np.int32] | None
) -> tuple[NDArray[np.int64], NDArray[np.int32] | None]:
    """The rows that are drawn and after them (K,) those whose partners they are; and the partners
    (K, 2) among these rows, -1 of rows that are not drawn."""
    if partners is None:
        return drawn, None
    row = np.full(len(partners), -1, np.int32)
    row[drawn] = np.arange(len(drawn))
    wanted = partners[drawn]
    beyond = np.unique(wanted[(wanted >= 0) & (row[wanted] < 0)])
    row[beyond] = len(drawn) + np.arange(len(beyond))
    found = np.full((len(drawn) + len(beyond), 2), -1, np.int32)
    found[: len(drawn)] = np.where(wanted >= 0, row[wanted], -1)
    return np.concatenate([drawn, beyond]), found


def _least(settings: AssetSettings) -> float:
    """The least half width in UV."""
    return settings.shape.least_half_width / settings.resolution


def _around_pores(
    centres: NDArray[np.float32], root: NDArray[np.float64], settings: AssetSettings
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Corners (N, 2) and (N, 2) of the boxes around pores at any stretch."""
    response = settings.response
    reach = rim_reach(root) * widest(response.beta_w, response.log_stretch_limit)
    if least := _least(settings):  # of an ellipse no axis of which is below it
        reach = np.hypot(reach, least)
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
    weight: NDArray[np.float32] | NDArray[np.bool_],
    low: NDArray[np.floating],
    high: NDArray[np.floating],
) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (weight > 0) & (high > 0).all(axis=1) & (low < 1).all(axis=1)
    return inside


def _blocks(low: NDArray[np.floating], high: NDArray[np.floating], resolution: int) -> CellLists:
    texel = 1.0 / resolution
    return list_by_cell(low - texel, high + texel, resolution // BLOCK, top_down=True)


def _check_cover(
    low: NDArray[np.floating],
    high: NDArray[np.floating],
    resolution: int,
    what: str,
    udim: int,
    factor: int = 1,
) -> None:
    size = np.maximum(np.minimum(high, 1.0) - np.maximum(low, 0.0), 0.0)
    cover = float(np.prod(size, axis=1, dtype=np.float64).sum()) / factor**2
    if cover > _MOST_COVER:
        raise LimitError(
            f"the {what} cover {cover:.0f} times the map of UDIM {udim} at their widest: "
            f"more than {_MOST_COVER:.0f} (at {resolution}² texels)"
        )
