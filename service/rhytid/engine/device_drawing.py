"""Level 0 of an asset's maps, drawn by every method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_bins import DeviceBins
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_grain import DeviceGrain
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.device_neutral import DeviceNeutral
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.convolve import NeutralTile
from rhytid.pipeline.levels import Draw, render_to_host
from rhytid.pipeline.redraw import redrawing


class DeviceDrawing:
    """Draws tiles and squares of level 0. Every method runs in a task of the device."""

    def __init__(
        self,
        base: DeviceMesh,
        frames: DeviceFrames,
        grain: DeviceGrain,
        bins: DeviceBins,
        neutral: DeviceNeutral,
    ) -> None:
        self._base, self._frames, self._grain, self._bins = base, frames, grain, bins
        self._neutral = neutral

    def to_host(
        self, frame: Frame, query: MapQuery, udim: int, level: int, row: int, column: int, side: int
    ) -> NDArray[np.float32]:
        """(side, side) displacement drawn anew: `redraw` of the frame, or `neutral`."""
        draw = self._redrawn(frame, query, udim)
        return render_to_host(self._base.device, draw, level, row, column, side)

    def tiles(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """float32 of level-0 tiles of one UDIM by any method: all are enqueued before the first is
        read. What does not depend on the frame is kept: precomputed maps, and the neutral tiles of
        `convolved`."""
        if query.method == "binned":
            return self._bins.blended(frame, query, addresses)
        place, side = self._base.settings.grid.first_texel, self._base.settings.tile_size
        return [self._draw(frame, query, a.udim)(*place(a), side) for a in addresses]

    def square(
        self, frame: Frame, query: MapQuery, udim: int, row: int, column: int, side: int
    ) -> Buffer:
        """float32 of `side`² texels of level 0 by any method but `binned`. What `convolved` reads
        is kept; raises Unmade where it is not there and takes long."""
        return self._draw(frame, query, udim)(row, column, side)

    def _draw(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws squares by any method but `binned`."""
        if query.method == "convolved":
            return self._convolved(frame, query, udim)
        return self._redrawn(frame, query, udim)

    def _redrawn(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws `redraw` of the frame, or `neutral`."""
        deformed = NEUTRAL_FRAME if query.method == "neutral" else frame
        lines = self._lines(deformed, query, udim)
        return self._grain.added(lines, deformed, query, udim)

    def _lines(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws wrinkles and pores of a frame, without grain."""
        base, scales = self._base, self._frames.scales(frame, query, udim)
        return redrawing(base.device, base.elements[udim], base.settings, scales)

    def _convolved(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        def draw(row: int, column: int, side: int) -> Buffer:
            neutral = self._neutral.tile(query, udim, (row, column, side))
            return self._convolve(neutral, frame, query, udim)

        return self._grain.added(draw, frame, query, udim)

    def _convolve(self, tile: NeutralTile, frame: Frame, query: MapQuery, udim: int) -> Buffer:
        base, model = self._base, query.stretch
        if query.sampling == "nearest":
            kernels = self._frames.kernels(frame, model)
            return base.convolve.tile(tile, kernels, base.settings)
        fields, located = self._frames.fields(frame, model), base.located[udim]
        return base.smooth_convolve.tile(tile, fields, located, base.settings)
