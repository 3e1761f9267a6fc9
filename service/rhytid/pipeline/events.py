"""Adds the events of a graph, single features of the skin, to what any method draws.
Kernels: respond.cl, smooth.cl, events.cl.

They are few, and their heights are added to those of wrinkles and pores: lines run on over a scar,
and `binned`, whose maps do not hold them, has them as exactly as `redraw`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.programs import NO_DEFINES
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.event_elements import EventElements
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.nearby import FrameValues
from rhytid.pipeline.redraw import Responder, pore_responder, take_over
from rhytid.pipeline.smooth import SmoothFields, smooth_pore_responder
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.work import BLOCK, Square

# How the layer of codes of events is called, and the share of the log stretch that it answers to,
# in the middle of those of the kinds.
EVENT_LAYER, EVENT_ANSWER = "events", 0.35
# Of a code to that of the coarse map: what the fine map is of, so that both have 15 bits.
_FINER = 254.0
_LARGEST_CODE = 127
# Rows of a block that a work-item of events.cl draws.
_STRIP = 8
# Room in the codes for events whose feet overlap.
_ROOM = 1.2


def event_scales(device: Device, events: EventElements) -> FrameValues:
    """Room for (σ_w, σ_d) of each event of a UDIM in one frame, not initialised."""
    return FrameValues.allocate(device, 2 * events.count)


def fill_events(
    device: Device, events: EventElements, settings: AssetSettings, stretch: StretchBuffers,
    scales: FrameValues,
) -> None:  # fmt: skip
    """Alg. 2 for every event, with the share of the log stretch that its kind answers to.

    scales: of `event_scales`.
    """
    _respond(device, events, pore_responder(device, settings, stretch), scales)


def respond_events_smooth(
    device: Device,
    events: EventElements,
    located: UdimTriangles,
    settings: AssetSettings,
    fields: SmoothFields,
) -> FrameValues:
    """As `fill_events`, each event at its own point."""
    scales = event_scales(device, events)
    _respond(device, events, smooth_pore_responder(device, located, settings, fields), scales)
    return scales


def event_steps(tallest: float, settings: AssetSettings) -> tuple[float, float]:
    """Mesh units for a code of the coarse and of the fine map of events.  tallest: depths."""
    assert settings.depth is not None
    coarse = _ROOM * tallest * settings.depth / _LARGEST_CODE
    return coarse, coarse / _FINER


def event_codes(
    heights: NDArray[np.float32], steps: tuple[float, float]
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """The coarse and the fine codes (n, n) of heights (n, n): these are the sum of both, each times
    its step."""
    most = _LARGEST_CODE
    coarse = np.clip(np.rint(heights.astype(np.float64) / steps[0]), -most, most)
    fine = np.clip(np.rint((heights - coarse * steps[0]) / steps[1]), -most, most)
    return coarse.astype(np.int8), fine.astype(np.int8)


def _respond(
    device: Device, events: EventElements, responder: Responder, scales: FrameValues
) -> None:
    found = scales.values
    responder(events.count, events.centres, events.triangle, events.stiffness, found)
    take_over(device, events.origins, responder, found, NO_DEFINES)


def add_events(
    device: Device,
    events: EventElements,
    settings: AssetSettings,
    scales: Buffer,
    square: Square,
    out: Buffer,
) -> None:
    """Add the events of a frame to a square (row, column, texels per side) of level 0, all
    multiples of BLOCK.

    scales: of the frame, as `fill_events` has them.  out: side² float32, mesh units; more may
    follow.
    """
    row, column, side = square
    device.launch(
        "events", "add_events", (side // BLOCK, side // _STRIP),
        events.centres, events.roots, events.forms, scales, events.lists.offsets,
        events.lists.members, np.float32(settings.shape.least_half_width),
        np.float32(settings.depth), np.int32(settings.resolution // BLOCK),
        np.int32(row // BLOCK), np.int32(column // BLOCK), np.int32(side), out,
        defines={"BLOCK": BLOCK, "STRIP": _STRIP},
    )  # fmt: skip
