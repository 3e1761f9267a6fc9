"""What is added in a frame to what any method draws: events and grain."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.engine.device_assets.frames import DeviceFrames, fill_missing, grain_place_of
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.event_elements import EventElements
from rhytid.pipeline.events import add_events, event_scales, fill_events, respond_events_smooth
from rhytid.pipeline.grain import Grain, GrainPlanes, grain_codes, relief, tiles_of_square
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.nearby import FrameValues
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.work import Place, Square


class DeviceEvents:
    """The events of an asset in a frame, to be added to what any method draws."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames) -> None:
        self._base, self._frames = base, frames
        self._last: tuple[int, ...] | None = None

    def added(self, draw: Draw, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """Draws as `draw` does, and adds the events of a frame."""
        if self._base.elements[udim].events is None:
            return draw

        return _adding(draw, lambda out, square: self.add(out, frame, query, udim, square))

    def add(self, out: Buffer, frame: Frame, query: MapQuery, udim: int, square: Square) -> None:
        """Add the events of a frame to a square of level 0."""
        base, events = self._base, self._base.elements[udim].events
        if events is not None:
            scales = self._scales(frame, query, udim, events, square)
            add_events(base.device, events, base.settings, scales, square, out)

    @property
    def tallest(self) -> float:
        """Height of the highest or deepest event, depths; 0 where there is none."""
        every = (elements.events for elements in self._base.elements.values())
        return max((events.tallest for events in every if events is not None), default=0.0)

    def heights(self, udim: int, square: Square) -> NDArray[np.float32]:
        """(n, n) of the events of a square of level 0 in the neutral, mesh units."""
        base, side, last = self._base, square[2], self._last
        # Those of the last square are kept: both samples of its codes are asked for in turn.
        self._last = (udim, *square)
        if last is not None and last != self._last:
            base.cache.discard("event heights", *last)
        make = partial(self._in_neutral, udim, square)
        out = base.cache.keep("event heights", *self._last, make=make)
        found: NDArray[np.float32] = base.device.read(out, (side, side), np.float32)
        return found

    def _in_neutral(self, udim: int, square: Square) -> Buffer:
        out = self._base.device.full(square[2] ** 2, np.float32(0.0))
        self.add(out, NEUTRAL_FRAME, MapQuery("neutral"), udim, square)
        return out

    def _scales(
        self, frame: Frame, query: MapQuery, udim: int, events: EventElements, square: Square
    ) -> Buffer:
        base, frames, model, sampling = self._base, self._frames, query.stretch, query.sampling
        device, settings = base.device, base.settings

        def make() -> FrameValues:
            if sampling == "smooth":
                fields, located = frames.fields(frame, model), base.located[udim]
                return respond_events_smooth(device, events, located, settings, fields)
            return event_scales(device, events)

        found: FrameValues = base.cache.keep_of(
            frame, "event scales", udim, model, sampling, make=make
        )
        if sampling != "smooth":
            what, blended = ("events", udim, model), query.method == "binned"
            alone = frames.alone(frame, what, udim, square, blended)

            def fill(near: Place | None) -> StretchBuffers:
                stretch = frames.stretch(frame, model, near)
                fill_events(device, events, settings, stretch, found)
                return stretch

            fill_missing(found.filled, alone, lambda place: place, fill)
        return found.values


class DeviceGrain:
    """The grain of an asset: its codes by tile, and its gain in a frame."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames) -> None:
        self._base, self._frames = base, frames

    @property
    def shows(self) -> bool:
        """Whether the settings have grain."""
        return relief(self._base.settings) > 0.0

    def added(self, draw: Draw, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """Draws as `draw` does, and adds the grain of a frame."""
        if not self.shows:
            return draw

        return _adding(draw, lambda out, square: self.add(out, frame, query, udim, square))

    def add(self, out: Buffer, frame: Frame, query: MapQuery, udim: int, square: Square) -> None:
        """Add the grain of a frame to a square of level 0; only where grain `shows`."""
        grain = self._of_frame(frame, query, udim, square)
        for at in tiles_of_square(*square, self._base.tile_side):
            grain.add(out, square, grain_place_of(self._base, udim, *at), self.codes(udim, *at))

    def codes(self, udim: int, row: int, column: int) -> Buffer:
        """The codes of grain of the tile of level 0 with this first texel."""
        base, square = self._base, (row, column, self._base.tile_side)
        return base.cache.keep(
            "grain", udim, row, column,
            make=lambda: grain_codes(
                base.device, self._planes(), base.located[udim], base.settings, square
            ),
        )  # fmt: skip

    def _of_frame(self, frame: Frame, query: MapQuery, udim: int, square: Square) -> Grain:
        base, frames, model = self._base, self._frames, query.stretch
        fields = frames.fields(frame, model) if query.sampling == "smooth" else None
        alone = frames.alone(frame, ("gains", udim, model), udim, None if fields else square)
        stretch = frames.stretch(frame, model, alone)
        gains = frames.gains(frame, model, alone)
        return Grain(base.device, base.settings, base.located[udim], stretch, gains, fields)

    def _planes(self) -> GrainPlanes:
        base = self._base
        shares = base.relief_shares, base.patch_size
        make = partial(GrainPlanes, base.device, base.mesh, base.settings, *shares)
        return base.cache.keep("planes", make=make)


def _adding(draw: Draw, add: Callable[[Buffer, Square], None]) -> Draw:
    """Draws as `draw` does, and adds to what it drew."""

    def drawn(row: int, column: int, side: int) -> Buffer:
        out = draw(row, column, side)
        add(out, (row, column, side))
        return out

    return drawn
