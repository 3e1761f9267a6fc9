"""What `convolved` reads of an asset: squares of its neutral map, kept, with their surroundings."""

from __future__ import annotations

from functools import partial

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.engine.unmade import Unmade
from rhytid.pipeline.convolve import MOST_TAPS, NeutralTile
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.redraw import redrawing
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK, Square

# Texels that may be drawn around a square, at most: the aprons of both passes, and up to a block.
_AROUND = 2 * (MOST_TAPS + VECTOR) + BLOCK


class DeviceNeutral:
    """Keeps them under the memory budget. Every method but `make` runs in a task of the device."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames) -> None:
        self._base, self._frames = base, frames

    def tile(self, query: MapQuery, udim: int, square: Square) -> NeutralTile:
        """What is convolved for a square of level 0; made where it is not there. Raises Unmade
        where that takes long and the asset is `bounded`."""
        found: NeutralTile | None = self._find(query, udim, square)
        if found is not None:
            return found
        row, column, side = square
        around = (row - _AROUND, column - _AROUND, side + 2 * _AROUND)
        elements = self._elements(udim)
        if self._base.bounded and elements.work.of(*around) > elements.pace.most:
            raise Unmade(lambda resident: resident.neutral.make(query, udim, square))
        return self._keep(query, udim, square, self._made(query, udim, square))

    def make(self, query: MapQuery, udim: int, square: Square) -> None:
        """Make and keep it, unless it is there; from any thread, see `Device.from_elsewhere`."""
        step = self._base.device.step
        if step(partial(self._find, query, udim, square)) is None:
            step(partial(self._keep, query, udim, square, self._made(query, udim, square)))

    def _find(self, query: MapQuery, udim: int, square: Square) -> NeutralTile | None:
        return self._base.kept.find("neutral", query.sampling, udim, *square)

    def _keep(self, query: MapQuery, udim: int, square: Square, made: NeutralTile) -> NeutralTile:
        """What is kept from now on; `made` is released where there is another by now."""
        key = ("neutral", query.sampling, udim, *square)
        kept = self._base.kept.keep(*key, make=lambda: made)
        if kept is not made:
            made.release()
        return kept

    def _made(self, query: MapQuery, udim: int, square: Square) -> NeutralTile:
        base = self._base
        maker = base.convolve if query.sampling == "nearest" else base.smooth_convolve
        draw = partial(self._drawn, udim)
        return maker.neutral_tile(draw, base.located[udim], base.settings, udim, *square)

    def _drawn(self, udim: int, row: int, column: int, side: int) -> Buffer:
        """Wrinkles and pores of a square of the neutral map, piece by piece, a step each."""
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
