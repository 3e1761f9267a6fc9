"""The levels of an asset's maps on the device.

Level 0 is drawn in pieces, and the levels above each piece are kept under the memory budget: a
third of what level 0 takes. The coarsest levels, the mip tail, are kept as whole maps, so that a
tile of theirs is not read from hundreds of pieces.
"""

from __future__ import annotations

import math
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.drawing import DeviceDrawing
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import Halves, MapQuery, Tile
from rhytid.formats.tiles import half_tile
from rhytid.pipeline.levels import Levels, Part, coarser, read_halves, read_parts
from rhytid.pipeline.work import BLOCK, Square

# Level-0 texels per side of a piece, the most that one task of the device draws. Wrinkles are drawn
# best in large launches, and sixteen tiles of the usual size are one launch of the blend. A piece
# of `binned` is a tile where that is larger.
_PIECE = {"neutral": 2048, "redraw": 2048, "binned": 2048, "convolved": 1024}
# Of coarser levels of `binned`, at most: a tile of theirs would draw four times what it needs.
_COARSE_PIECE = 1024
# These methods keep arrays of each tile from one frame to the next.
_BY_TILE = ("binned", "convolved")
# Those of which a piece is smaller where drawing it would take long.
_BY_WORK = ("neutral", "redraw")
# Level 0 is kept where so many maps of it would fit into the memory that is left.
_PLENTY = 8
# Texels per side of the finest level of the mip tail, at most.
_TAIL = 512
# A square of float32 or of half floats, to which its numbers are rounded then.
Room = NDArray[Any]


class DeviceLevels:
    """Squares of every level."""

    def __init__(self, base: DeviceMesh, finest: DeviceFinest) -> None:
        self._base, self._finest = base, finest

    @property
    def tail(self) -> int:
        """The finest level of the mip tail."""
        side = self._base.settings.resolution
        return max((side // _TAIL).bit_length() - 1, 1)

    def pieces(self, query: MapQuery, udim: int, level: int, square: Square) -> list[Square]:
        """The pieces that a square of a level below the mip tail, or of its finest level, is drawn
        in, each in a task of its own. Safe from any thread."""
        found = self._finest.pieces(query, udim, _finer(square, level), coarse=level > 0)
        return [(row >> level, column >> level, side >> level) for row, column, side in found]

    def is_long(self, query: MapQuery, udim: int, square: Square) -> bool:
        """Whether a square of level 0 is more than one piece. Safe from any thread."""
        return not self._finest.is_piece(query, udim, square)

    def least(self, query: MapQuery, level: int) -> int:
        """Texels per side of the smallest square of a level that can be drawn alone."""
        finest = self._base.tile_side if query.method == "binned" else BLOCK
        return max(finest >> level, 1)

    def squares(
        self, frame: Frame, query: MapQuery, udim: int, level: int, places: Mapping[Square, Room]
    ) -> dict[Square, Room]:
        """Of some squares of a level, each inside one piece: the kept ones, and the first that is
        not kept, which is drawn. Other tasks run before the next one is drawn.

        places: the squares, and memory that each is read into, and comes in, where it is of level
        0.
        """
        found, drawn = {}, False
        for square, out in places.items():
            tile = self._kept(frame, query, udim, level, square, out)
            if tile is None and not drawn:
                tile, drawn = self._made(frame, query, udim, level, square, out), True
            if tile is not None:
                found[square] = tile
        return found

    def square_alone(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square,
        out: Room | None = None,
    ) -> Room:  # fmt: skip
        """One square of a level, drawn from the smallest part of level 0 that it needs; nothing is
        kept.  out: memory that one of level 0 is read into."""
        frame, place = _frame_of(frame, query), _finer(square, level)
        with self._finest.parts(frame, query, udim, place) as parts:
            if level == 0:
                return self._finest.joined(parts, place, out)
            levels = self._halved(parts, place, level)
            tile: Tile = self._base.device.read(levels.buffers[-1], (square[2],) * 2, np.float32)
        levels.release()
        return tile

    def of_tail(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square,
        finest: Tile | None = None, settings: AssetSettings | None = None,
    ) -> Tile | None:  # fmt: skip
        """A square of a level of the mip tail, reduced from the finest level of the tail where that
        is given.

        None where the tail is neither kept nor given, or was drawn with other settings.
        """
        frame = _frame_of(frame, query)
        key = ("tail", *_names(query), udim)
        levels: Levels | None = self._base.cache.find_of(frame, *key)
        kept = levels is not None
        if levels is None:
            if finest is None or self._base.settings is not settings:
                return None
            levels = self._tail_of(finest)
            if self._keeps:
                made, kept = levels, True
                self._base.cache.keep_of(frame, *key, make=lambda: made)
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
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square, out: Room
    ) -> Room | None:
        frame, place = _frame_of(frame, query), _finer(square, level)
        if level == 0:
            return self._finest.cropped(frame, query, udim, place, out)
        piece = self._finest.piece_of(query, udim, place)
        levels = self._base.cache.find_of(frame, "levels", *_names(query), udim, *piece)
        return None if levels is None else self._of_levels(levels, level, square, piece)

    def _made(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square, out: Room
    ) -> Room:
        if level == 0 or not self._keeps:
            return self.square_alone(frame, query, udim, level, square, out)
        frame, place = _frame_of(frame, query), _finer(square, level)
        piece = self._finest.piece_of(query, udim, place)
        with self._finest.parts(frame, query, udim, piece) as parts:
            levels = self._base.cache.keep_of(
                frame, "levels", *_names(query), udim, *piece,
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


class DeviceFinest:
    """Tiles of level 0, and the parts that larger squares of it are made of.

    Squares of the last frame are kept; those of the next frame reuse their memory.
    """

    def __init__(self, base: DeviceMesh, drawing: DeviceDrawing) -> None:
        self._base, self._drawing = base, drawing
        self._kept_frame: Hashable = None
        self._kept_keys: tuple[tuple[Hashable, ...], ...] = ()

    def tiles(self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]) -> list[Tile]:
        """(n, n) float32 of level-0 tiles of a UDIM; all are enqueued before the first is read."""
        udim = addresses[0].udim
        places = [self._base.square(address) for address in addresses]
        found = {place: self.cropped(frame, query, udim, place) for place in places}
        missing = [place for place, tile in found.items() if tile is None]
        if missing:
            with self._drawn_parts(frame, query, udim, dict.fromkeys(missing)) as parts:
                found.update(zip(missing, map(self._read, parts), strict=True))
        return [tile for tile in found.values() if tile is not None]

    def half_tiles(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Halves]:
        """As `tiles`, as half floats; raises QueryError where these cannot hold them."""
        udim, places = addresses[0].udim, map(self._base.square, addresses)
        held = {place: self._find_finest(frame, query, udim, place) for place in places}
        with self._drawn_parts(frame, query, udim, held) as parts:
            return [self._halves(part) for part in parts]

    def _halves(self, part: Part) -> Halves:
        found = read_halves(self._base.device, part.buffer, part.side)
        return half_tile(self._read(part)) if found is None else found

    def pieces(self, query: MapQuery, udim: int, place: Square, *, coarse: bool) -> list[Square]:
        """The pieces that a square of level 0 is drawn in, each in a task of its own.  coarse: for
        a coarser level. Safe from any thread."""
        work, largest = self._base.elements[udim].work, self._largest(query, coarse=coarse)
        return work.cut(place, self._most(query, udim), largest)

    def is_piece(self, query: MapQuery, udim: int, place: Square) -> bool:
        """Whether a square of level 0 is drawn in one task. Safe from any thread."""
        work, largest = self._base.elements[udim].work, self._largest(query, coarse=False)
        return work.is_piece(place, self._most(query, udim), largest)

    def piece_of(self, query: MapQuery, udim: int, place: Square) -> Square:
        """The piece for coarser levels that a square of level 0 lies in."""
        work, largest = self._base.elements[udim].work, self._largest(query, coarse=True)
        return work.around(place, self._most(query, udim), largest)

    def _largest(self, query: MapQuery, *, coarse: bool) -> int:
        """Level-0 texels per side of the largest piece, for level 0 or for a coarser one."""
        side = min(_PIECE[query.method], self._base.settings.resolution)
        if query.method != "binned":
            return side
        return max(min(side, _COARSE_PIECE) if coarse else side, self._base.tile_side)

    def _most(self, query: MapQuery, udim: int) -> float:
        """The work of a piece, at most."""
        return self._base.elements[udim].pace.most if query.method in _BY_WORK else math.inf

    @property
    def _plenty(self) -> bool:
        budget = self._base.device.budget
        return _PLENTY * 4 * self._base.settings.resolution**2 <= budget.limit - budget.used

    def _cut(self, frame: Frame, query: MapQuery, udim: int, place: Square) -> list[Square]:
        """The squares that a square of level 0 is drawn in: tiles, where the tiles or what they are
        made of are kept; otherwise itself, in one launch."""
        row, column, side = place
        tile = self._base.tile_side
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
        """The parts of a square of level 0, kept or drawn; see `_drawn_parts`."""
        held = {
            part: self._find_finest(frame, query, udim, part)
            for part in self._cut(frame, query, udim, place)
        }
        return self._drawn_parts(frame, query, udim, held)

    @contextmanager
    def _drawn_parts(
        self, frame: Frame, query: MapQuery, udim: int, held: Mapping[Square, Buffer | None]
    ) -> Iterator[list[Part]]:
        """Parts of level 0: the squares that are `held`, and those with None, which are drawn here
        and kept where memory is plenty. The caller reads them in the block, whose time counts for
        the pace."""
        missing = [place for place, buffer in held.items() if buffer is None]
        start = time.perf_counter()
        drawn = self._drawing.squares(frame, query, udim, missing) if missing else []
        fresh = dict(zip(missing, drawn, strict=True))
        yield [Part(*place, buffer or fresh[place]) for place, buffer in held.items()]
        if missing and query.method in _BY_WORK:
            elements = self._base.elements[udim]
            work = sum(elements.work.of(*place) for place in missing)
            elements.pace.took(work, time.perf_counter() - start)
        for place, buffer in fresh.items():
            if self._plenty:
                self._keep_finest(frame, query, udim, place, buffer)
            else:
                buffer.release()

    def cropped(
        self, frame: Frame, query: MapQuery, udim: int, place: Square, out: Room | None = None
    ) -> Room | None:
        """A square of level 0, out of itself or the piece around it, whichever is kept; None where
        neither is.  out: memory that it is read into."""
        buffer, larger = self._find_finest(frame, query, udim, place), place
        if buffer is None and (larger := self.piece_of(query, udim, place)) != place:
            buffer = self._find_finest(frame, query, udim, larger)
        if buffer is None:
            return None
        return self.joined([Part(*larger, buffer)], place, out)

    def _find_finest(
        self, frame: Frame, query: MapQuery, udim: int, place: Square
    ) -> Buffer | None:
        found: Buffer | None = self._base.cache.find(*_finest_key(frame, query, udim, place))
        return found

    def _keep_finest(
        self, frame: Frame, query: MapQuery, udim: int, place: Square, buffer: Buffer
    ) -> None:
        key = _finest_key(frame, query, udim, place)
        if key[-1] != self._kept_frame:
            for old in self._kept_keys:
                self._base.cache.discard(*old)
            self._kept_frame, self._kept_keys = key[-1], ()
        self._kept_keys += (key,)
        self._base.cache.keep(*key, make=lambda: buffer)

    def _read(self, part: Part) -> Tile:
        found: Tile = self._base.device.read(part.buffer, (part.side, part.side), np.float32)
        return found

    def joined(self, parts: Sequence[Part], place: Square, out: Room | None = None) -> Room:
        """A square that its parts make up, or lies in one.  out: memory that it is read into, as
        its numbers are."""
        whole = np.empty((place[2], place[2]), np.float32) if out is None else out
        read_parts(self._base.device, parts, place, whole)
        return whole


def _names(query: MapQuery) -> tuple[str, str, str]:
    """A query as part of a key."""
    return query.method, query.stretch, query.sampling


def _finest_key(frame: Frame, query: MapQuery, udim: int, place: Square) -> tuple[Hashable, ...]:
    """The key of a square of level 0. It ends with the digest of the frame; `neutral` is the same
    in all frames."""
    digest = NEUTRAL_FRAME.digest if query.method == "neutral" else frame.digest
    return ("finest", *_names(query), udim, *place, digest)


def _finer(square: Square, level: int) -> Square:
    """A square of a level in texels of level 0."""
    row, column, side = square
    return row << level, column << level, side << level


def _frame_of(frame: Frame, query: MapQuery) -> Frame:
    """The frame that squares are kept for: the neutral one for `neutral`, which is the same in all
    frames."""
    return NEUTRAL_FRAME if query.method == "neutral" else frame
