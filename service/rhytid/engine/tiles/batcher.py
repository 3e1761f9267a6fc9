"""Draws concurrent requests for tiles of one frame in one task of the device.

While a task waits for its turn, requests for the same tile join it and share its array. On a GPU,
requests for other tiles of the same frame, method and level join it too, and all are enqueued
before the first is read: between two tasks a GPU waits for the host. A processor does not wait, and
there sixteen answers at once were slower than one after the other.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from rhytid.domain.tiles import TileAddress
from rhytid.domain.wording import waiting_requests
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import BusyError, RhytidError

# Float32, or half floats where the key says so.
Tile = NDArray[Any]
DrawTiles = Callable[[list[TileAddress]], list[Tile]]
# The most tiles that one task draws: other tasks wait for the device, too.
MOST_TILES = 16
_MOST_TEXELS = 4096**2


@dataclass(eq=False)
class _Batch:
    """Tiles that one task will draw, and the requests that wait for each."""

    draw: DrawTiles
    tiles: dict[TileAddress, Future[Tile]] = field(default_factory=dict)
    waiting: int = 0

    def fail(self, error: BaseException) -> None:
        """Give an error to all requests whose tile is not drawn."""
        for future in self.tiles.values():
            if not future.done():
                future.set_exception(error)


class TileBatcher:
    """Gathers requests that wait for the device at the same time.

    task: the context that a batch is drawn in.  most: how many different tiles one task draws.
    """

    def __init__(
        self,
        worker: DeviceWorker,
        task: Callable[[], AbstractContextManager[None]],
        most: int = MOST_TILES,
    ) -> None:
        self._worker, self._task, self.most = worker, task, most
        self._lock = threading.Lock()
        self._open: dict[Hashable, _Batch] = {}
        self._joined = 0

    @property
    def joined(self) -> int:
        """How many requests wait for a task that another one queued."""
        return self._joined

    def tile(
        self,
        key: Hashable,
        address: TileAddress,
        texels: int,
        draw: DrawTiles,
        turn: Hashable = None,
    ) -> Tile:
        """One tile (texels, texels), read-only, of the frame, method and level that `key` names.

        draw: draws several tiles.  turn: the turn of its task, see `DeviceWorker`.

        Raises BusyError where too many requests wait already, and the error that drawing this tile
        raises.
        """
        most = max(min(self.most, _MOST_TEXELS // texels**2), 1)
        with self._lock:
            batch = self._open.get(key)
            if batch and (address in batch.tiles or len(batch.tiles) < most):
                future = self._join(batch, address)
                leads = False
            else:
                batch = self._open[key] = _Batch(draw)
                future = batch.tiles[address] = Future()
                leads = True
        if leads:
            self._lead(key, batch, turn)
        try:
            return future.result()
        finally:  # else its error's traceback and this frame hold each other
            del future

    def _join(self, batch: _Batch, address: TileAddress) -> Future[Tile]:
        size = self._worker.size
        if self._worker.waiting + self._joined >= size:
            raise BusyError(f"{waiting_requests(size)} already")
        self._joined += 1
        batch.waiting += 1
        return batch.tiles.setdefault(address, Future())

    def _lead(self, key: Hashable, batch: _Batch, turn: Hashable) -> None:
        """Have a batch drawn; whatever happens, every request that joined gets a tile or an
        error."""
        try:
            self._worker.call(lambda: self._draw(key, batch), turn)
        except BaseException as error:  # noqa: BLE001 handed to the requests that wait for it
            self._close(key, batch)
            batch.fail(error)
        finally:  # else frames of an error and the error hold each other
            batch.tiles.clear()

    def _close(self, key: Hashable, batch: _Batch) -> list[TileAddress]:
        """Close the batch to further requests."""
        with self._lock:
            if self._open.get(key) is batch:
                del self._open[key]
            self._joined -= batch.waiting
            batch.waiting = 0
            return list(batch.tiles)

    def _draw(self, key: Hashable, batch: _Batch) -> None:
        addresses = self._close(key, batch)
        try:
            self._finish(batch, addresses)
        except RhytidError:
            if len(addresses) == 1:
                raise
            # Together they may need more than there is, or one of them is at fault.
            for address in addresses:
                self._finish_alone(batch, address)

    def _finish_alone(self, batch: _Batch, address: TileAddress) -> None:
        try:
            self._finish(batch, [address])
        except RhytidError as error:
            batch.tiles[address].set_exception(error)

    def _finish(self, batch: _Batch, addresses: list[TileAddress]) -> None:
        with self._task():
            tiles = batch.draw(addresses)
        for address, tile in zip(addresses, tiles, strict=True):
            tile.setflags(write=False)
            batch.tiles[address].set_result(tile)
