"""Level 0 of an asset's maps, drawn by every method."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_bins import DeviceBins
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_grain import DeviceGrain
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.levels import Draw, render_to_host
from rhytid.pipeline.neutral_tiles import NeutralTile, NeutralTiles
from rhytid.pipeline.redraw import redrawing


class DeviceDrawing:
    """Draws tiles and squares of level 0. Every method runs on the device thread."""

    def __init__(
        self, base: DeviceMesh, frames: DeviceFrames, grain: DeviceGrain, bins: DeviceBins
    ) -> None:
        self._base, self._frames, self._grain, self._bins = base, frames, grain, bins

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
        return [self._draw(frame, query, a)(*place(a), side) for a in addresses]

    def square(
        self, frame: Frame, query: MapQuery, udim: int, row: int, column: int, side: int
    ) -> Buffer:
        """float32 of `side`² texels of level 0 by any method but `binned`; nothing is kept."""
        if query.method != "convolved":
            return self._redrawn(frame, query, udim)(row, column, side)
        maker, convolve = self._convolving(frame, query, udim)

        def draw(row: int, column: int, side: int) -> Buffer:
            neutral = self._neutral_tile(maker, udim, row, column, side)
            out = convolve(neutral)
            neutral.release()
            return out

        return self._grain.added(draw, frame, query, udim)(row, column, side)

    def _draw(self, frame: Frame, query: MapQuery, address: TileAddress) -> Draw:
        """What draws a tile of any method but `binned`."""
        if query.method == "convolved":
            return self._convolved(frame, query, address)
        return self._redrawn(frame, query, address.udim)

    def _redrawn(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws `redraw` of the frame, or `neutral`."""
        deformed = NEUTRAL_FRAME if query.method == "neutral" else frame
        lines = self._lines(deformed, query, udim)
        return self._grain.added(lines, deformed, query, udim)

    def _lines(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws wrinkles and pores of a frame, without grain."""
        base, scales = self._base, self._frames.scales(frame, query, udim)
        return redrawing(base.device, base.elements[udim], base.settings, scales)

    def _convolved(self, frame: Frame, query: MapQuery, address: TileAddress) -> Draw:
        maker, convolve = self._convolving(frame, query, address.udim)

        def draw(row: int, column: int, side: int) -> Buffer:
            def make() -> NeutralTile:
                return self._neutral_tile(maker, address.udim, row, column, side)

            return convolve(self._base.kept.keep("neutral", query.sampling, address, make=make))

        return self._grain.added(draw, frame, query, address.udim)

    def _convolving(
        self, frame: Frame, query: MapQuery, udim: int
    ) -> tuple[NeutralTiles, Callable[[NeutralTile], Buffer]]:
        """What makes the neutral tiles of a sampling, and what convolves them in a frame."""
        base, model = self._base, query.stretch
        if query.sampling == "nearest":
            kernels, plain = self._frames.kernels(frame, model), base.convolve
            return plain, lambda tile: plain.tile(tile, kernels, base.settings)
        smooth, located = base.smooth_convolve, base.located[udim]
        fields = self._frames.fields(frame, model)
        return smooth, lambda tile: smooth.tile(tile, fields, located, base.settings)

    def _neutral_tile(
        self, maker: NeutralTiles, udim: int, row: int, column: int, side: int
    ) -> NeutralTile:
        """The neutral tile that is convolved for `side`² texels of level 0."""
        base, draw = self._base, self._lines(NEUTRAL_FRAME, MapQuery("neutral"), udim)
        return maker.neutral_tile(draw, base.located[udim], base.settings, udim, row, column, side)
