"""Level 0 of an asset's maps, drawn by every method, and the neutral squares that `convolved`
reads."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.additions import DeviceEvents, DeviceGrain
from rhytid.engine.device_assets.bins import DeviceBins
from rhytid.engine.device_assets.frames import DeviceFrames
from rhytid.engine.device_assets.mesh import DeferredWork, DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.convolve import MOST_TAPS, NeutralTile
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import Draw, render_to_host
from rhytid.pipeline.redraw import redrawing
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK, Square

# Texels that may be drawn around a square, at most: the aprons of both passes, and up to a block.
_AROUND = 2 * (MOST_TAPS + VECTOR) + BLOCK


class DeviceDrawing:
    """Draws squares of level 0."""

    def __init__(
        self,
        base: DeviceMesh,
        frames: DeviceFrames,
        grain: DeviceGrain,
        bins: DeviceBins,
        neutral: DeviceNeutral,
        events: DeviceEvents,
    ) -> None:
        self._base, self._frames, self._grain, self._bins = base, frames, grain, bins
        self._neutral, self._events = neutral, events

    def to_host(
        self, frame: Frame, query: MapQuery, udim: int, level: int, row: int, column: int, side: int
    ) -> NDArray[np.float32]:
        """(side, side) displacement drawn anew, by `redraw` or `neutral`."""
        draw = self._redrawn(frame, query, udim)
        return render_to_host(self._base.device, draw, level, row, column, side)

    def squares(
        self, frame: Frame, query: MapQuery, udim: int, places: Sequence[Square]
    ) -> list[Buffer]:
        """float32 of squares of level 0 by any method; for `binned` the squares are tiles. All are
        enqueued before the first is read.

        Precomputed maps and the neutral squares of `convolved`, which do not depend on the frame,
        are kept. Raises DeferredWork where they are not there and take long.
        """
        if query.method == "binned":
            tile = self._base.tile_side
            at = [TileAddress(udim, 0, row // tile, column // tile) for row, column, _ in places]
            made = self._bins.blended(frame, query, at)
            for out, place in zip(made, places, strict=True):
                self._events.add(out, frame, query, udim, place)
            self._add_residual(made, udim, places)
            return made
        drawn = self._convolved if query.method == "convolved" else self._redrawn
        draw = drawn(frame, query, udim)
        return [draw(*place) for place in places]

    def _redrawn(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """Draws squares of `redraw` or `neutral`."""
        deformed = NEUTRAL_FRAME if query.method == "neutral" else frame
        lines = self._lines(deformed, query, udim)
        return self._finished(lines, deformed, query, udim)

    def _lines(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """Draws wrinkles and pores of a frame, without grain."""
        base = self._base

        def draw(row: int, column: int, side: int) -> Buffer:
            scales = self._frames.scales(frame, query, udim, (row, column, side))
            return redrawing(base.device, base.elements[udim], base.settings, scales)(
                row, column, side
            )

        return draw

    def _convolved(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        def draw(row: int, column: int, side: int) -> Buffer:
            neutral = self._neutral.tile(query, udim, (row, column, side))
            return self._convolve(neutral, frame, query, udim)

        return self._finished(draw, frame, query, udim)

    def _finished(self, draw: Draw, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """Draws as `draw` does, with grain, events and the residual."""
        grained = self._grain.added(draw, frame, query, udim)
        whole = self._events.added(grained, frame, query, udim)

        def with_residual(row: int, column: int, side: int) -> Buffer:
            out = whole(row, column, side)
            self._add_residual([out], udim, [(row, column, side)])
            return out

        return with_residual if udim in self._base.residuals else whole

    def _add_residual(self, outs: Sequence[Buffer], udim: int, squares: Sequence[Square]) -> None:
        """Add the residual of a scanned skin to squares of level 0; nothing in other skin."""
        residual = self._base.residuals.get(udim)
        if residual is not None:
            residual.add(self._base.device, outs, squares)

    def _convolve(self, tile: NeutralTile, frame: Frame, query: MapQuery, udim: int) -> Buffer:
        base, model = self._base, query.stretch
        if query.sampling == "nearest":
            kernels = self._frames.kernels(frame, model)
            return base.convolve.tile(tile, kernels, base.settings)
        fields, located = self._frames.fields(frame, model), base.located[udim]
        return base.smooth_convolve.tile(tile, fields, located, base.settings)


class DeviceNeutral:
    """Squares of the neutral map that `convolved` reads, with their surroundings, kept under the
    memory budget."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames) -> None:
        self._base, self._frames = base, frames

    def tile(self, query: MapQuery, udim: int, square: Square) -> NeutralTile:
        """The neutral square that is convolved for a square of level 0, made where it is not there.
        Raises DeferredWork where that takes long and the asset is `bounded`."""
        found: NeutralTile | None = self._find(query, udim, square)
        if found is not None:
            return found
        row, column, side = square
        around = (row - _AROUND, column - _AROUND, side + 2 * _AROUND)
        elements = self._elements(udim)
        if self._base.bounded and elements.work.of(*around) > elements.pace.most:
            raise DeferredWork(neutral=(query, udim, square))
        return self._keep(query, udim, square, self._made(query, udim, square))

    def make(self, query: MapQuery, udim: int, square: Square) -> None:
        """Make and keep a neutral square, unless it is there; on a thread that uses the device in
        steps, see `Device.in_steps`."""
        device = self._base.device
        if device.step(partial(self._find, query, udim, square)) is None:
            device.step(partial(self._keep, query, udim, square, self._made(query, udim, square)))
            device.hand_over()

    def _find(self, query: MapQuery, udim: int, square: Square) -> NeutralTile | None:
        return self._base.cache.find("neutral", query.sampling, udim, *square)

    def _keep(self, query: MapQuery, udim: int, square: Square, made: NeutralTile) -> NeutralTile:
        """Keep a neutral square and return it; where there is another by now, release it and return
        that one."""
        key = ("neutral", query.sampling, udim, *square)
        kept = self._base.cache.keep(*key, make=lambda: made)
        if kept is not made:
            made.release()
        return kept

    def _made(self, query: MapQuery, udim: int, square: Square) -> NeutralTile:
        base = self._base
        maker = base.convolve if query.sampling == "nearest" else base.smooth_convolve
        draw = partial(self._drawn, udim)
        return maker.neutral_tile(draw, base.located[udim], base.settings, udim, *square)

    def _drawn(self, udim: int, row: int, column: int, side: int) -> Buffer:
        """Draw wrinkles and pores of a square of the neutral map, piece by piece, a step each."""
        device, elements = self._base.device, self._elements(udim)
        pieces = elements.work.cut((row, column, side), elements.pace.most, side)
        if len(pieces) == 1:
            return device.step(partial(self._piece, udim, pieces[0]))
        out = device.empty(side * side, np.float32)
        for piece in pieces:
            to = ((piece[0] - row) * side + piece[1] - column, side)
            device.step(partial(self._copy_piece, udim, piece, out, to))
        return out

    def _copy_piece(self, udim: int, piece: Square, out: Buffer, to: tuple[int, int]) -> None:
        drawn = self._piece(udim, piece)
        self._base.device.copy_square(drawn, out, to, piece[2], 4)
        self._base.device.finish()
        drawn.release()

    def _piece(self, udim: int, piece: Square) -> Buffer:
        base, elements = self._base, self._elements(udim)
        scales = self._frames.scales(NEUTRAL_FRAME, MapQuery("neutral"), udim)
        with elements.pace.timing(elements.work.of(*piece)):
            drawn = redrawing(base.device, elements, base.settings, scales)(*piece)
            base.device.finish()
        return drawn

    def _elements(self, udim: int) -> UdimElements:
        return self._base.elements[udim]
