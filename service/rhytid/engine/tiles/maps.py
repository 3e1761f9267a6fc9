"""Squares of any level, put together from bounded pieces of work; other tasks run on the device
between two pieces."""

from __future__ import annotations

import math
import threading
from collections import defaultdict, deque
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rhytid.domain.wording import waiting_requests
from rhytid.engine import call_context
from rhytid.engine.assets.asset import Asset
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.device_assets.levels import DeviceLevels
from rhytid.engine.frames import Frame
from rhytid.engine.messages import Halves, MapQuery, Tile
from rhytid.errors import BusyError, CancelledError, ChangingError, DeviceMemoryError
from rhytid.pipeline.work import Square

# Memory of an array.
Room = NDArray[np.uint8]
# Pieces of which those that are kept are looked for in one task.
_AT_ONCE = 64
# How often a square is drawn anew because the settings changed meanwhile.
_ATTEMPTS = 3


class _Drawing:
    """A square that one caller draws, and the number of others that wait for it."""

    def __init__(self) -> None:
        self.tile: Future[Tile] = Future()
        self.joined = 0


class MapDrawing:
    """Draws squares of maps.

    The first task of a square raises BusyError where too many calls wait; later tasks wait for a
    place, so that no request is refused half-way.  most: callers that may wait for a drawing of
    another caller.  memory: of the maps that are drawn.
    """

    def __init__(self, on_device: DeviceAssets, most: int) -> None:
        self._on_device, self._most = on_device, most
        self.memory = MemoryAgain()
        self._lock = threading.Lock()
        self._drawing: dict[Hashable, _Drawing] = {}
        self.joined = 0

    def shared(
        self, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Tile:
        """As `square`, read-only; concurrent calls for the same square share one array.

        Raises BusyError where too many wait already, CancelledError where the caller is gone.
        """
        key = (asset, asset.settings, frame.digest, query, udim, level, square)
        while True:
            with self._lock:
                drawing = self._drawing.get(key)
                if drawing is None:
                    mine = self._drawing[key] = _Drawing()
                elif self.joined >= self._most:
                    raise BusyError(f"{waiting_requests(self._most)} already")
                else:
                    self.joined += 1
                    drawing.joined += 1
            if drawing is None:
                try:
                    return self._draw(
                        key, mine, lambda: self.square(asset, frame, query, udim, level, square)
                    )
                finally:
                    del mine
            with suppress(CancelledError):
                return self._joining(drawing)
            call_context.check_abandoned()  # else the one that drew was gone before this one joined

    def _draw(self, key: Hashable, mine: _Drawing, draw: Callable[[], Tile]) -> Tile:
        """Draw for all callers that join; stops where all of them are gone, and this caller too."""
        try:
            with call_context.also_awaited(lambda: mine.joined > 0):
                tile = draw()
            tile.setflags(write=False)
        except BaseException as error:
            self._forget(key)
            mine.tile.set_exception(error)
            del mine  # else the error's traceback and this frame hold each other
            raise
        self._forget(key)
        mine.tile.set_result(tile)
        return tile

    def _forget(self, key: Hashable) -> None:
        """Let nobody join any more."""
        with self._lock:
            del self._drawing[key]

    def _joining(self, drawing: _Drawing) -> Tile:
        """The tile that another caller draws; raises CancelledError where this caller is gone, or
        the other one was."""
        try:
            while not wait([drawing.tile], call_context.LOOK).done:
                call_context.check_abandoned()
            return drawing.tile.result()
        finally:
            with self._lock:
                self.joined -= 1
                drawing.joined -= 1

    def square(
        self, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Tile:
        """(side, side) float32 displacement of a square of a level, all of it with the same
        settings.

        Raises ChangingError where the settings change again and again meanwhile, DeviceMemoryError
        where even a single tile cannot be drawn, CancelledError where nobody waits for the square
        any more.
        """
        return self._of_type(np.float32, asset, frame, query, udim, level, square)

    def halves(
        self, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Halves:
        """As `square`, as half floats, rounded to even, infinite where they cannot hold a
        number."""
        return self._of_type(np.float16, asset, frame, query, udim, level, square)

    def _of_type(
        self, dtype: DTypeLike, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int,
        square: Square,
    ) -> NDArray[Any]:  # fmt: skip
        for _ in range(_ATTEMPTS):
            settings = asset.settings
            drawing = _Square(self._on_device, asset, frame, query, udim, self.memory)
            found = drawing.draw(level, square, np.dtype(dtype))
            if found is not None and asset.settings is settings:
                # Of float32 where it is so coarse, or memory was so short, that it has no place.
                return found.astype(dtype, copy=False)
        raise ChangingError(f"the settings of asset {asset.id} change while its map is drawn")


class _Square:
    """One square of one frame that is being drawn."""

    def __init__(
        self,
        on_device: DeviceAssets,
        asset: Asset,
        frame: Frame,
        query: MapQuery,
        udim: int,
        memory: MemoryAgain,
    ) -> None:
        self._on_device, self._asset, self._memory = on_device, asset, memory
        # The asset may be dropped meanwhile: only facts that follow from its settings are used.
        self._resident = on_device.loaded(asset)
        self._settings = self._resident.mesh.settings
        self._query, self._about = query, (frame, query, udim)
        self._waits = False

    def draw(self, level: int, square: Square, dtype: np.dtype[Any]) -> NDArray[Any] | None:
        """A square of a level, of `dtype` or of float32; None where the settings changed
        meanwhile."""
        tail = self._resident.levels.tail
        if level < tail:
            return self._of_pieces(level, square, dtype)
        tile: Tile | None = self._run(DeviceLevels.of_tail, *self._about, level, square)
        if tile is None:
            whole = (0, 0, self._settings.grid.side(tail))
            finest = self._of_pieces(tail, whole, np.dtype(np.float32))
            tile = self._run(
                DeviceLevels.of_tail, *self._about, level, square, finest, self._settings
            )
        return tile

    def _of_pieces(self, level: int, square: Square, dtype: np.dtype[Any]) -> NDArray[Any]:
        """A square of a level that is drawn from level 0, piece by piece."""
        pieces = self._resident.levels.pieces(self._query, self._about[2], level, square)
        out = self._memory.empty((square[2], square[2]), dtype)
        if len(pieces) == 1:
            return self._some(level, {square: out})[square]
        while pieces:
            some, others = pieces[:_AT_ONCE], pieces[_AT_ONCE:]
            views = {piece: _view(out, square, piece) for piece in some}
            found = self._some(level, views)
            for piece, tile in found.items():
                if tile is not views[piece]:
                    views[piece][...] = tile
            pieces = [piece for piece in some if piece not in found] + others
        return out

    def _some(self, level: int, missing: dict[Square, NDArray[Any]]) -> dict[Square, NDArray[Any]]:
        """At least the first of some squares, each of which lies inside of a piece; those of level
        0 in their places, which are given, unless memory is short."""
        try:
            found: dict[Square, NDArray[Any]] = self._run(
                DeviceLevels.squares, *self._about, level, missing
            )
            return found
        except DeviceMemoryError:
            first = next(iter(missing))
            return {first: self._alone(level, first)}

    def _alone(self, level: int, square: Square) -> Tile:
        """A square for which memory is short: as a whole, or else by its quarters."""
        try:
            tile: Tile = self._run(DeviceLevels.square_alone, *self._about, level, square)
            return tile
        except DeviceMemoryError:
            half = square[2] // 2
            if half < self._resident.levels.least(self._query, level):
                raise
        quarters = [self._alone(level, quarter) for quarter in _cut(square, half)]
        return np.block([quarters[:2], quarters[2:]])

    def _run(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Run a method of the levels of the asset in a task of the device."""
        call_context.check_abandoned()
        waits, self._waits = self._waits, True
        return self._on_device.use(
            self._asset, lambda resident: task(resident.levels, *arguments), patiently=waits
        )


def _view(out: NDArray[Any], whole: Square, square: Square) -> NDArray[Any]:
    """The part of `out`, which holds the square `whole`, that a square in it has."""
    y, x, side = square[0] - whole[0], square[1] - whole[1], square[2]
    return out[y : y + side, x : x + side]


def _cut(square: Square, side: int) -> list[Square]:
    """Squares of `side` that make up a larger one, row by row."""
    row, column, whole = square
    steps = range(0, whole, side)
    return [(row + y, column + x, side) for y in steps for x in steps]


class MemoryAgain:
    """Gives arrays their memory. It comes back when neither an array nor a part of it is held any
    more, and stays for the next one of its size while a block of `kept` runs: fresh memory is
    cleared by the system when it is first touched, which takes as long as a copy. Safe from any
    thread."""

    def __init__(self) -> None:
        self._lock, self._blocks = threading.Lock(), 0
        # By their bytes. Of its own type, since memory comes back whenever an array goes, in the
        # midst of a call here, too: no lock is taken then.
        self._spare: defaultdict[int, deque[Room]] = defaultdict(deque)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """While the block runs memory is kept; at its end, or that of the last such block, what
        nobody holds is freed."""
        with self._lock:
            self._blocks += 1
        try:
            yield
        finally:
            with self._lock:
                self._blocks -= 1
                if not self._blocks:
                    self._spare.clear()

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """As `np.empty`."""
        if not self._blocks:
            return np.empty(shape, dtype)
        nbytes = math.prod(shape) * np.dtype(dtype).itemsize
        try:
            room = self._spare[nbytes].pop()
        except IndexError:
            room = np.empty(nbytes, np.uint8)
        return np.asarray(_Lent(room, self._take_back)).view(dtype).reshape(shape)

    def _take_back(self, room: Room) -> None:
        if self._blocks:
            self._spare[room.nbytes].append(room)


class _Lent:
    """What numpy holds as long as any array lies in some memory: no array itself, in whose place
    numpy would hold the one that owns the memory."""

    def __init__(self, room: Room, give_back: Callable[[Room], None]) -> None:
        self._room, self._give_back = room, give_back
        self.__array_interface__ = room.__array_interface__

    def __del__(self) -> None:
        self._give_back(self._room)
