"""The levels of an asset's maps on the device.

Level 0 is drawn in pieces, and the levels above each piece are kept under the memory budget: a
third of what level 0 takes. The coarsest levels, the mip tail, are kept as whole maps, so that a
tile of theirs is not read from hundreds of pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.device_finest import DeviceFinest, Tile, names
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.levels import Levels, Part, coarser
from rhytid.pipeline.work import BLOCK, Square

# Texels per side of the finest level of the mip tail, at most.
_TAIL = 512


class DeviceLevels:
    """Squares of every level. Every method runs in a task of the device."""

    def __init__(self, base: DeviceMesh, finest: DeviceFinest) -> None:
        self._base, self._finest = base, finest

    @property
    def tail(self) -> int:
        """The finest level of the mip tail."""
        side = self._base.settings.resolution
        return max((side // _TAIL).bit_length() - 1, 1)

    def pieces(self, query: MapQuery, udim: int, level: int, square: Square) -> list[Square]:
        """What a square of a level, below the crown or its finest, is drawn in, each in a task of
        its own. Safe from any thread."""
        found = self._finest.pieces(query, udim, _finer(square, level))
        return [(row >> level, column >> level, side >> level) for row, column, side in found]

    def is_long(self, query: MapQuery, udim: int, square: Square) -> bool:
        """Whether a square of level 0 is more than one piece. Safe from any thread."""
        return not self._finest.is_piece(query, udim, square)

    def least(self, query: MapQuery, level: int) -> int:
        """Texels per side of the smallest square of a level that can be drawn alone."""
        finest = self._base.settings.grid.texels(0) if query.method == "binned" else BLOCK
        return max(finest >> level, 1)

    def squares(
        self, frame: Frame, query: MapQuery, udim: int, level: int, wanted: Sequence[Square]
    ) -> dict[Square, Tile]:
        """Of some squares of a level, each inside one piece: those that are kept, and the first
        that is not, which is drawn. Other tasks run before the next."""
        found, drawn = {}, False
        for square in wanted:
            tile = self._kept(frame, query, udim, level, square)
            if tile is None and not drawn:
                tile, drawn = self._made(frame, query, udim, level, square), True
            if tile is not None:
                found[square] = tile
        return found

    def square_alone(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Tile:
        """One square of a level, from the smallest part of level 0 that it needs; nothing is
        kept."""
        frame, place = _frame_of(frame, query), _finer(square, level)
        with self._finest.parts(frame, query, udim, place) as parts:
            if level == 0:
                return self._finest.joined(parts, place)
            levels = self._halved(parts, place, level)
            tile: Tile = self._base.device.read(levels.buffers[-1], (square[2],) * 2, np.float32)
        levels.release()
        return tile

    def of_tail(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square,
        finest: Tile | None = None, settings: AssetSettings | None = None,
    ) -> Tile | None:  # fmt: skip
        """A square of a level of the mip tail, reduced from its finest level if that is given.

        None if it is neither kept nor given, or was drawn with other settings.
        """
        frame = _frame_of(frame, query)
        key = ("tail", *names(query), udim)
        levels: Levels | None = self._base.kept.find_of(frame, *key)
        kept = levels is not None
        if levels is None:
            if finest is None or self._base.settings is not settings:
                return None
            levels = self._tail_of(finest)
            if self._keeps:
                made, kept = levels, True
                self._base.kept.keep_of(frame, *key, make=lambda: made)
        n = level - self.tail
        tile = self._base.device.read_square(levels.buffers[n], levels.side >> n, *square)
        if not kept:
            levels.release()
        return tile

    @property
    def _keeps(self) -> bool:
        """Whether the levels above a map take less than half of the memory."""
        return 8 * 4 * self._base.settings.resolution**2 // 3 <= self._base.device.budget.limit

    def _kept(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Tile | None:
        frame, place = _frame_of(frame, query), _finer(square, level)
        if level == 0:
            return self._finest.cropped(frame, query, udim, place)
        piece = self._finest.piece_of(query, udim, place)
        levels = self._base.kept.find_of(frame, "levels", *names(query), udim, *piece)
        return None if levels is None else self._of_levels(levels, level, square, piece)

    def _made(self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square) -> Tile:
        if level == 0 or not self._keeps:
            return self.square_alone(frame, query, udim, level, square)
        frame, place = _frame_of(frame, query), _finer(square, level)
        piece = self._finest.piece_of(query, udim, place)
        with self._finest.parts(frame, query, udim, piece) as parts:
            levels = self._base.kept.keep_of(
                frame, "levels", *names(query), udim, *piece,
                make=lambda: self._halved(parts, piece, self.tail),
            )  # fmt: skip
            return self._of_levels(levels, level, square, piece)

    def _of_levels(self, levels: Levels, level: int, square: Square, piece: Square) -> Tile:
        """A square from the levels of its piece."""
        row, column = (square[i] - (piece[i] >> level) for i in (0, 1))
        buffer = levels.buffers[level - 1]
        return self._base.device.read_square(buffer, piece[2] >> level, row, column, square[2])

    def _halved(self, parts: Sequence[Part], place: Square, count: int) -> Levels:
        row, column, side = place
        inside = [Part(p.row - row, p.column - column, p.side, p.buffer) for p in parts]
        return coarser(self._base.device, inside, side, count)

    def _tail_of(self, finest: Tile) -> Levels:
        side = len(finest)
        first = Part(0, 0, side, self._base.device.upload(finest))
        above = coarser(self._base.device, [first], side, side.bit_length() - 1)
        return Levels(side, (first.buffer, *above.buffers))


def _finer(square: Square, level: int) -> Square:
    """A square of a level in texels of level 0."""
    row, column, side = square
    return row << level, column << level, side << level


def _frame_of(frame: Frame, query: MapQuery) -> Frame:
    """What is kept of `neutral` is kept for all frames."""
    return NEUTRAL_FRAME if query.method == "neutral" else frame
