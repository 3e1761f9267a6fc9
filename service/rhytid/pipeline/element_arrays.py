"""The wrinkles and pores of one UDIM as arrays for drawing: in texels, sorted, listed by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.bins import EVEN, ShareRange
from rhytid.pipeline.cells import CellLists
from rhytid.pipeline.copies import Origins, copied, copies_last, skews_of
from rhytid.pipeline.cushion_layer import BroadLayer, CushionArrays, narrow_weight
from rhytid.pipeline.event_elements import around_events
from rhytid.pipeline.reach import (
    Bends,
    around_pores,
    around_wrinkles,
    bends_of,
    boxes_of_lines,
    drawn_rows,
    limit_cover,
    list_by_block,
    pore_roots,
    reaching_in,
    sizes_of_ends,
)
from rhytid.pipeline.work import DrawLimit
from rhytid.support import cancellation


@dataclass(frozen=True)
class WrinkleArrays:
    """K wrinkles of a UDIM in texels, v up.

    segments (K, 4): start and extent.  sizes (K, 2): half width and weight; where wrinkles bend or
    taper (K, 4), half widths at both ends, then weights.  triangle (K,): that each samples.  lists:
    by block.  stiffness (K,), or None: 1 throughout.  waves (K, 4): as in wave.clh; None where no
    wrinkle is wavy.  slopes (K, 2): as in line.clh; None where none bends or tapers.
    partners (K, 2) int32: the wrinkles that continue at both ends, -1 for none; None where no
    wrinkle continues.  shares (K, 2): as in Bends; None where all are 1.

    share_range: of the shares of the whole graph.

    Wrinkles come in this order: first `even` ones, then S copies and wrinkles with a metric, then
    partners that do not reach into the UDIM and are in no list.  skews (S, 4): of the second group,
    as in line.clh.  origins: where these sample stretch.

    cushion: the arrays of the broad layer, or None where there is none.
    rows (K,) int32: of the graph.
    """

    segments: NDArray[np.float32]
    sizes: NDArray[np.float32]
    triangle: NDArray[np.int32]
    lists: CellLists
    stiffness: NDArray[np.float32] | None = None
    waves: NDArray[np.float32] | None = None
    slopes: NDArray[np.float32] | None = None
    partners: NDArray[np.int32] | None = None
    shares: NDArray[np.float32] | None = None
    share_range: ShareRange = EVEN
    skews: NDArray[np.float32] | None = None
    origins: Origins | None = None
    even: int = 0
    cushion: CushionArrays | None = None
    rows: NDArray[np.int32] | None = None


@dataclass(frozen=True)
class PoreArrays:
    """K pores of a UDIM in texels, v up.

    centres (K, 2).  roots (K, 4): (xx, xy, yy, weight); the rim is where |root·d| = 1 with root =
    [[xx, xy], [0, yy]].  triangle (K,): that each samples.  lists: by block.  stiffness (K,), or
    None: 1 throughout.  origins: where the last of the pores, which are copies, sample stretch;
    None where there are none.
    """

    centres: NDArray[np.float32]
    roots: NDArray[np.float32]
    triangle: NDArray[np.int32]
    lists: CellLists
    stiffness: NDArray[np.float32] | None = None
    origins: Origins | None = None

    @property
    def copies(self) -> int:
        """How many of the pores are copies."""
        return 0 if self.origins is None else len(self.origins.triangle)


def wrinkle_arrays(
    graph: WrinkleGraph,
    triangle: NDArray[np.int32],
    settings: AssetSettings,
    udim: int,
    stiffness: NDArray[np.float32] | None = None,
    waves: NDArray[np.float32] | None = None,
) -> WrinkleArrays:
    """The arrays of the wrinkles with a strength above 0 that reach into the UDIM at any stretch.

    triangle, stiffness (M,): of every wrinkle of the graph.  waves (M, 4): the result of
    `wrinkle_waves`.  Raises LimitError where the wrinkles cover too much of the map.
    """
    cancellation.check()
    ends = (graph.node_uv - np.array(udim_origin(udim), np.float32))[graph.edge_nodes]
    bends = bends_of(graph, settings)
    lines = boxes_of_lines(graph, ends, bends)
    low, high = around_wrinkles(graph, lines, settings, bends, waves)
    cancellation.check()
    broad = BroadLayer.of(graph, lines, settings, bends, waves)
    reach = (low, high) if broad is None else broad.reach(low, high)
    last = copied(graph.edge_copy_of, graph.edge_metric)
    drawn, even = copies_last(drawn_rows(graph.edge_weight, *reach), last)
    limit_cover(low[drawn], high[drawn], settings.resolution, "wrinkles", udim)
    cancellation.check()
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
        list_by_block(low[drawn], high[drawn], settings.resolution),
        None if stiffness is None else stiffness[chosen],
        None if waves is None else waves[chosen] * np.array([size, 1, 1, 1], np.float32),
        None if bends is None else bends.slopes[chosen],
        partners,
        None if bends is None or bends.shares is None else bends.shares[chosen],
        ShareRange.of(graph),
        skews_of(graph, tail) if len(tail) else None,
        Origins.of(tail, graph.edge_copy_of, segments, triangle, stiffness),
        even,
        None if broad is None else broad.arrays(chosen, len(drawn), udim),
        chosen.astype(np.int32),
    )


def pore_arrays(
    graph: WrinkleGraph,
    triangle: NDArray[np.int32],
    settings: AssetSettings,
    udim: int,
    stiffness: NDArray[np.float32] | None = None,
) -> PoreArrays:
    """The arrays of the pores with a strength above 0 that reach into the UDIM at any stretch.

    triangle, stiffness (N,): of every pore of the graph.  Raises LimitError where the pores cover
    too much of the map.
    """
    cancellation.check()
    centres = graph.node_uv - np.array(udim_origin(udim), np.float32)
    root = pore_roots(graph)
    low, high = around_pores(centres, root, settings)
    chosen, first = copies_last(
        drawn_rows(graph.pore_weight, low, high), copied(graph.node_copy_of, None)
    )
    limit_cover(low[chosen], high[chosen], settings.resolution, "pores", udim)
    size = np.float32(settings.resolution)
    in_texels = root[chosen] / float(settings.resolution)
    weight = graph.node_weight[chosen, None]
    return PoreArrays(
        centres[chosen] * size,
        np.concatenate([in_texels, weight], axis=1).astype(np.float32),
        triangle[chosen],
        list_by_block(low[chosen], high[chosen], settings.resolution),
        None if stiffness is None else stiffness[chosen],
        Origins.of(
            chosen[first:],
            graph.node_copy_of,
            lambda rows: centres[rows] * size,
            triangle,
            stiffness,
        ),
    )


def check_cover(
    graph: WrinkleGraph, settings: AssetSettings, udim: int, limit: DrawLimit | None = None
) -> None:
    """Raise LimitError where `wrinkle_arrays` or `pore_arrays` would for what they cover, and where
    drawing takes longer than `limit`. Wrinkles are taken without waves, whose reach is known only
    where the wrinkles are located."""
    local = graph.node_uv - np.array(udim_origin(udim), np.float32)
    bends = bends_of(graph, settings)
    lines = boxes_of_lines(graph, local[graph.edge_nodes], bends)
    if (broad := BroadLayer.of(graph, lines, settings, bends)) is not None:
        broad.check(reaching_in(broad.swells, broad.low, broad.high), udim, limit)
    around = [
        ("wrinkle", graph.edge_weight, around_wrinkles(graph, lines, settings, bends)),
        ("pore", graph.pore_weight, around_pores(local, pore_roots(graph), settings)),
    ]
    if graph.node_kind is not None:
        around.append(("event", graph.event_weight, around_events(graph, local, settings)))
    for what, weight, (low, high) in around:
        inside = reaching_in(weight, low, high)
        low, high = low[inside], high[inside]
        limit_cover(low, high, settings.resolution, f"graph's {what}s", udim)
        if limit is not None:
            limit.check(low, high, settings.resolution, what, udim)


def _sizes(
    graph: WrinkleGraph, bends: Bends | None, chosen: NDArray[np.int64], settings: AssetSettings
) -> NDArray[np.float32]:
    """`sizes` of WrinkleArrays: (K, 2), or (K, 4) where there are bends."""
    half_widths, weights = (values[chosen] for values in sizes_of_ends(graph, bends))
    texels = np.float32(settings.resolution)
    return np.concatenate([half_widths * texels, narrow_weight(weights, settings.shape)], axis=1)


def _with_partners(
    drawn: NDArray[np.int64], partners: NDArray[np.int32] | None
) -> tuple[NDArray[np.int64], NDArray[np.int32] | None]:
    """(K,) the rows that are drawn, and after them their partners that are not; and (K, 2) the
    partners of each as numbers of these rows, -1 for none and for rows that are not drawn."""
    if partners is None:
        return drawn, None
    row = np.full(len(partners), -1, np.int32)
    row[drawn] = np.arange(len(drawn))
    named = partners[drawn]
    beyond = np.unique(named[(named >= 0) & (row[named] < 0)])
    row[beyond] = len(drawn) + np.arange(len(beyond))
    found = np.full((len(drawn) + len(beyond), 2), -1, np.int32)
    found[: len(drawn)] = np.where(named >= 0, row[named], -1)
    return np.concatenate([drawn, beyond]), found
