"""Level 0 of an asset's maps on the device, kept while memory is free."""

from __future__ import annotations

import math
import time
from collections.abc import Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_drawing import DeviceDrawing
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.levels import Part
from rhytid.pipeline.work import Square

Tile = NDArray[np.float32]

# Level-0 texels per side of a piece, the most that one task of the device draws. Wrinkles are drawn
# best in large launches; the other methods go tile by tile, and four tiles of the usual size are
# one launch of the blend. A piece of `binned` is a tile where that is larger.
_PIECE = {"neutral": 2048, "redraw": 2048, "binned": 1024, "convolved": 1024}
# These methods keep arrays of each tile from one frame to the next.
_BY_TILE = ("binned", "convolved")
# Those of which a piece is smaller where drawing it would take long.
_BY_WORK = ("neutral", "redraw")
# Level 0 is kept where so many maps of it would fit into the memory that is left.
_PLENTY = 8


class DeviceFinest:
    """Tiles of level 0, and the parts that larger squares of it are made of.

    Squares of the last frame are kept; those of the next frame reuse their memory. Every method
    runs in a task of the device.
    """

    def __init__(self, base: DeviceMesh, drawing: DeviceDrawing) -> None:
        self._base, self._drawing = base, drawing
        self._kept_frame: Hashable = None
        self._kept_keys: tuple[tuple[Hashable, ...], ...] = ()

    def tiles(self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]) -> list[Tile]:
        """(n, n) float32 of level-0 tiles of a UDIM; all are enqueued before the first is read."""
        udim, grid = addresses[0].udim, self._base.settings.grid
        side = grid.texels(0)
        places = [(*grid.first_texel(address), side) for address in addresses]
        found = [self.cropped(frame, query, udim, place) for place in places]
        missing = [place for place, tile in zip(places, found, strict=True) if tile is None]
        with self._drawn_parts(frame, query, udim, missing) as parts:
            read = iter([self._read(part) for part in parts])
        return [next(read) if tile is None else tile for tile in found]

    def pieces(self, query: MapQuery, udim: int, place: Square) -> list[Square]:
        """What a square of level 0 is drawn in, each in a task of its own. Safe from any thread."""
        work, most = self._base.elements[udim].work, self._most(query, udim)
        return work.cut(place, most, self._largest(query))

    def is_piece(self, query: MapQuery, udim: int, place: Square) -> bool:
        """Whether a square of level 0 is drawn in one task. Safe from any thread."""
        work, most = self._base.elements[udim].work, self._most(query, udim)
        return work.is_piece(place, most, self._largest(query))

    def piece_of(self, query: MapQuery, udim: int, place: Square) -> Square:
        """The piece that a square of level 0 lies in."""
        work, most = self._base.elements[udim].work, self._most(query, udim)
        return work.around(place, most, self._largest(query))

    def _largest(self, query: MapQuery) -> int:
        """Level-0 texels per side of the largest piece."""
        side = min(_PIECE[query.method], self._base.settings.resolution)
        return max(side, self._base.settings.grid.texels(0)) if query.method == "binned" else side

    def _most(self, query: MapQuery, udim: int) -> float:
        """The work of a piece, at most."""
        return self._base.elements[udim].pace.most if query.method in _BY_WORK else math.inf

    @property
    def _plenty(self) -> bool:
        budget = self._base.device.budget
        return _PLENTY * 4 * self._base.settings.resolution**2 <= budget.limit - budget.used

    def _cut(self, frame: Frame, query: MapQuery, udim: int, place: Square) -> list[Square]:
        """The squares that a square of level 0 is drawn in: tiles, if they or what they are made of
        are kept; else itself, in one launch."""
        row, column, side = place
        tile = self._base.settings.grid.texels(0)
        if tile > side:
            return [place]
        tiles = [
            (row + y, column + x, tile) for y in range(0, side, tile) for x in range(0, side, tile)
        ]
        kept = all(self._find_finest(frame, query, udim, t) is not None for t in tiles)
        return tiles if kept or query.method in _BY_TILE else [place]

    def parts(
        self, frame: Frame, query: MapQuery, udim: int, place: Square
    ) -> AbstractContextManager[list[Part]]:
        """Level 0 of a square in parts, kept or drawn."""
        return self._drawn_parts(frame, query, udim, self._cut(frame, query, udim, place))

    @contextmanager
    def _drawn_parts(
        self, frame: Frame, query: MapQuery, udim: int, places: Sequence[Square]
    ) -> Iterator[list[Part]]:
        """Level 0 of some squares, kept or drawn; what was drawn stays where memory is plenty. What
        is read of them is read in the block: it tells how long they took."""
        held = {place: self._find_finest(frame, query, udim, place) for place in places}
        missing = [place for place, buffer in held.items() if buffer is None]
        start = time.perf_counter()
        fresh = dict(zip(missing, self._drawn(frame, query, udim, missing), strict=True))
        yield [Part(*place, held[place] or fresh[place]) for place in places]
        if missing and query.method in _BY_WORK:
            elements = self._base.elements[udim]
            work = sum(elements.work.of(*place) for place in missing)
            elements.pace.took(work, time.perf_counter() - start)
        for place, buffer in fresh.items():
            if self._plenty:
                self._keep_finest(frame, query, udim, place, buffer)
            else:
                buffer.release()

    def _drawn(
        self, frame: Frame, query: MapQuery, udim: int, places: Sequence[Square]
    ) -> list[Buffer]:
        """float32 of squares of level 0 that are all as large."""
        tile = self._base.settings.grid.texels(0)
        if places and places[0][2] == tile:
            at = [TileAddress(udim, 0, row // tile, column // tile) for row, column, _ in places]
            return self._drawing.tiles(frame, query, at)
        return [self._drawing.square(frame, query, udim, *place) for place in places]

    def cropped(self, frame: Frame, query: MapQuery, udim: int, place: Square) -> Tile | None:
        """A square of level 0 out of what is kept of it, alone or with its piece."""
        for larger in (place, self.piece_of(query, udim, place)):
            buffer = self._find_finest(frame, query, udim, larger)
            if buffer is not None:
                row, column = (place[i] - larger[i] for i in (0, 1))
                return self._base.device.read_square(buffer, larger[2], row, column, place[2])
        return None

    def _find_finest(
        self, frame: Frame, query: MapQuery, udim: int, place: Square
    ) -> Buffer | None:
        found: Buffer | None = self._base.kept.find(*_finest_key(frame, query, udim, place))
        return found

    def _keep_finest(
        self, frame: Frame, query: MapQuery, udim: int, place: Square, buffer: Buffer
    ) -> None:
        key = _finest_key(frame, query, udim, place)
        if key[-1] != self._kept_frame:
            for old in self._kept_keys:
                self._base.kept.discard(*old)
            self._kept_frame, self._kept_keys = key[-1], ()
        self._kept_keys += (key,)
        self._base.kept.keep(*key, make=lambda: buffer)

    def _read(self, part: Part) -> Tile:
        found: Tile = self._base.device.read(part.buffer, (part.side, part.side), np.float32)
        return found

    def joined(self, parts: Sequence[Part], place: Square) -> Tile:
        """A square put together from its parts."""
        row, column, side = place
        out = np.empty((side, side), np.float32)
        for part in parts:
            y, x = part.row - row, part.column - column
            out[y : y + part.side, x : x + part.side] = self._read(part)
        return out


def names(query: MapQuery) -> tuple[str, str, str]:
    """A query as part of a key."""
    return query.method, query.stretch, query.sampling


def _finest_key(frame: Frame, query: MapQuery, udim: int, place: Square) -> tuple[Hashable, ...]:
    """What belongs to a frame has its digest last; `neutral` is the same in all."""
    digest = NEUTRAL_FRAME.digest if query.method == "neutral" else frame.digest
    return ("finest", *names(query), udim, *place, digest)
