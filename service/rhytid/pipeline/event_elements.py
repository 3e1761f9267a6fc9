"""The events of one UDIM, single features of the skin: as arrays for drawing, in texels, and
on the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.events import ANSWERS, EVENT_DEPTHS, FORMS, SIGNS
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.cells import CellLists, Lists
from rhytid.pipeline.copies import OriginBuffers, Origins, copied, copies_last
from rhytid.pipeline.nearby import Numbers, in_square, united
from rhytid.pipeline.reach import (
    Box,
    around_pores,
    drawn_rows,
    limit_cover,
    list_by_block,
    pore_roots,
    widest,
)
from rhytid.pipeline.work import BLOCK, Square


@dataclass(frozen=True)
class EventArrays:
    """K events of a UDIM in texels, v up.

    centres (K, 2).  roots (K, 4): (xx, xy, yy, height in depths, below 0 for pits); the rim is as
    that of PoreArrays.  forms (K, 2): plateau and rim, see events.cl.  triangle (K,): that each
    samples.  stiffness (K,): the share of the log stretch there that each answers to.  lists: by
    block.  origins: of the last of them, which are copies; None where there are none.
    """

    centres: NDArray[np.float32]
    roots: NDArray[np.float32]
    forms: NDArray[np.float32]
    triangle: NDArray[np.int32]
    stiffness: NDArray[np.float32]
    lists: CellLists
    origins: Origins | None = None


def event_arrays(
    graph: WrinkleGraph,
    triangle: NDArray[np.int32],
    settings: AssetSettings,
    udim: int,
    stiffness: NDArray[np.float32] | None = None,
) -> EventArrays | None:
    """The arrays of the events that reach into the UDIM at any stretch; None where none does.

    triangle, stiffness (N,): of every node of the graph.  Raises LimitError where the events cover
    too much of the map.
    """
    if graph.node_kind is None:
        return None
    centres = graph.node_uv - np.array(udim_origin(udim), np.float32)
    root, (low, high) = pore_roots(graph), around_events(graph, centres, settings)
    chosen, first = copies_last(
        drawn_rows(graph.event_weight, low, high), copied(graph.node_copy_of, None)
    )
    if not len(chosen):
        return None
    limit_cover(low[chosen], high[chosen], settings.resolution, "events", udim)
    size, kind = np.float32(settings.resolution), graph.node_kind
    height = EVENT_DEPTHS * SIGNS[kind[chosen]] * graph.node_weight[chosen]
    answer = ANSWERS[kind] if stiffness is None else ANSWERS[kind] * stiffness
    in_texels = root[chosen] / float(settings.resolution)
    return EventArrays(
        centres[chosen] * size,
        np.concatenate([in_texels, height[:, None]], axis=1).astype(np.float32),
        FORMS[kind[chosen]],
        triangle[chosen],
        answer[chosen],
        list_by_block(low[chosen], high[chosen], settings.resolution),
        Origins.of(
            chosen[first:], graph.node_copy_of, lambda rows: centres[rows] * size, triangle, answer
        ),
    )


def around_events(
    graph: WrinkleGraph, centres: NDArray[np.float32], settings: AssetSettings
) -> Box:
    """Corners (N, 2) and (N, 2) of the boxes around the nodes of a graph, at centres (N, 2), as far
    as events reach at any stretch."""
    response = settings.response
    scales = [widest(response.beta_w * a, response.log_stretch_limit) for a in ANSWERS.tolist()]
    scale = np.array(scales)[graph.node_kind][:, None]
    return around_pores(centres, pore_roots(graph), settings, scale)


class EventElements:
    """EventArrays on the device.

    tallest: height of the highest or deepest, depths.
    """

    def __init__(self, device: Device, events: EventArrays) -> None:
        self.count, self.tallest = len(events.centres), float(np.abs(events.roots[:, 3]).max())
        copies = 0 if events.origins is None else len(events.origins.triangle)
        self.centres = device.upload(events.centres)
        self.roots = device.upload(events.roots)
        self.forms = device.upload(events.forms)
        self.triangle = device.upload(events.triangle)
        self.stiffness = device.upload(events.stiffness)
        self.lists, self._cells = Lists.upload(device, events.lists), events.lists
        self.origins = OriginBuffers.upload(device, events.origins, self.count - copies)

    def nearby(self, square: Square) -> Numbers:
        """Those that may be drawn in a square of level 0."""
        return united([in_square(self._cells, square, BLOCK)])

    def release(self) -> None:
        """Give the memory back."""
        for value in vars(self).values():
            if isinstance(value, Lists | Buffer | OriginBuffers):
                value.release()
