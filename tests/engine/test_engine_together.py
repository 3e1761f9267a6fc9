"""Tiles that wait at the same time are drawn in one task; nobody waits for ever."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest

from engine.engines import QUERIES, built, draw, new_asset, running
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.tiles.batcher import Tile, TileBatcher
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import BusyError, DeviceMemoryError, LimitError, NotFoundError

ADDRESSES = [TileAddress(1001, 0, row, column) for row in range(4) for column in range(4)]


@contextmanager
def occupied(worker: DeviceWorker) -> Iterator[None]:
    """The device has something to do until the block ends."""
    begun, ended = threading.Event(), threading.Event()

    def occupy() -> None:
        begun.set()
        ended.wait(60)

    thread = threading.Thread(target=worker.call, args=(occupy,))
    thread.start()
    try:
        assert begun.wait(60)
        yield
    finally:
        ended.set()
        thread.join()


def until(reached: Callable[[], bool]) -> None:
    for _ in range(6000):
        if reached():
            return
        time.sleep(0.01)
    raise AssertionError("it never came")


class Desk:
    """Requests at a TileBatcher whose drawing is a function of the addresses."""

    def __init__(self, size: int, fail: Callable[[list[TileAddress]], Exception | None]) -> None:
        self.worker = DeviceWorker(size)
        self.together = TileBatcher(self.worker, nullcontext)
        self.drawn: list[list[TileAddress]] = []
        self._fail = fail

    def draw(self, addresses: list[TileAddress]) -> list[Tile]:
        self.drawn.append(addresses)
        error = self._fail(addresses)
        if error is not None:
            raise error
        return [np.full((64, 64), 10.0 * a.row + a.column, np.float32) for a in addresses]

    def ask(self, address: TileAddress, texels: int = 64) -> Tile:
        return self.together.tile("frame", address, texels, self.draw)

    def ask_at_once(self, addresses: list[TileAddress], texels: int = 64) -> list[Future[Tile]]:
        """Each asks while the device is at work and the ones before it wait."""
        with ThreadPoolExecutor(len(addresses)) as pool, occupied(self.worker):
            asked: list[Future[Tile]] = []
            for address in addresses:
                asked.append(pool.submit(self.ask, address, texels))
                until(lambda: self.waiting == len(asked) or asked[-1].done())
        return asked

    @property
    def waiting(self) -> int:
        return self.worker.waiting + self.together.joined

    def close(self) -> None:
        self.worker.close()


@contextmanager
def desk(
    size: int = 64, fail: Callable[[list[TileAddress]], Exception | None] = lambda _: None
) -> Iterator[Desk]:
    with closing(Desk(size, fail)) as made:
        yield made
        assert made.waiting == 0


def test_those_who_wait_are_drawn_together() -> None:
    with desk() as made:
        asked = made.ask_at_once([*ADDRESSES[:3], ADDRESSES[1]])
        tiles = [future.result(60) for future in asked]

        assert made.drawn == [ADDRESSES[:3]]
        assert [tile[0, 0] for tile in tiles] == [0, 1, 2, 1]
        assert tiles[1] is tiles[3]
        assert not tiles[1].flags.writeable


def test_who_comes_later_is_drawn_later() -> None:
    with desk() as made:
        assert made.ask(ADDRESSES[0])[0, 0] == 0
        assert made.ask(ADDRESSES[0])[0, 0] == 0
        assert made.drawn == [[ADDRESSES[0]], [ADDRESSES[0]]]


@pytest.mark.parametrize(("texels", "most"), [(2048, 4), (4096, 1), (64, 16)])
def test_a_task_does_not_grow_without_bounds(texels: int, most: int) -> None:
    wanted = [*ADDRESSES, TileAddress(1001, 0, 5, 5)]
    with desk() as made:
        for future in made.ask_at_once(wanted, texels):
            future.result(60)

        assert len(made.drawn[0]) == most
        assert [a for addresses in made.drawn for a in addresses] == wanted


def test_the_same_tile_joins_a_task_that_is_full() -> None:
    with desk() as made:
        asked = made.ask_at_once([*ADDRESSES, ADDRESSES[3]])

        assert asked[-1].result(60) is asked[3].result(60)
        assert made.drawn == [ADDRESSES]


def test_what_fails_together_is_tried_alone() -> None:
    bad = ADDRESSES[1]

    def fail(addresses: list[TileAddress]) -> Exception | None:
        if addresses == [bad]:
            return NotFoundError("gone")
        return DeviceMemoryError("too much") if len(addresses) > 1 else None

    with desk(fail=fail) as made:
        asked = made.ask_at_once(ADDRESSES[:3])

        assert [asked[i].result(60)[0, 0] for i in (0, 2)] == [0, 2]
        with pytest.raises(NotFoundError, match="gone"):
            asked[1].result(60)


@pytest.mark.parametrize("error", [NotFoundError("gone"), ZeroDivisionError("a bug")])
def test_an_error_reaches_everybody(error: Exception) -> None:
    with desk(fail=lambda _: error) as made:
        for future in made.ask_at_once(ADDRESSES[:3]):
            with pytest.raises(type(error), match=str(error)):
                future.result(60)


def test_too_many_are_refused_and_the_others_served() -> None:
    with desk(size=2) as made:
        asked = made.ask_at_once(ADDRESSES[:4])

        assert [asked[i].result(60)[0, 0] for i in (0, 1)] == [0, 1]
        for future in asked[2:]:
            with pytest.raises(BusyError, match="2 requests wait"):
                future.result(60)
        assert made.ask(ADDRESSES[3])[0, 0] == 3


def test_where_the_queue_is_full_the_first_is_refused_too() -> None:
    with desk(size=1) as made, ThreadPoolExecutor(1) as pool, occupied(made.worker):
        filling = pool.submit(made.worker.call, lambda: 5)
        until(lambda: made.worker.waiting == 1)
        with pytest.raises(BusyError):
            made.ask(ADDRESSES[0])
    assert filling.result(60) == 5


@pytest.mark.parametrize("level", [0, 2])
def test_tiles_drawn_together_have_the_bits_of_those_drawn_alone(
    tmp_path: Path, level: int
) -> None:
    with running(tmp_path) as engine:
        engine.tiles._batcher.most = 16  # a processor has one
        asset = built(engine, new_asset())
        engine.frames.put(asset, "bent", deform(sheet().positions, 1, 0.15))
        addresses = engine.assets._assets.get(asset).settings.grid.addresses(1001, level)
        wanted = [(query, address) for query in QUERIES for address in addresses]
        alone = [engine.tiles.plan(asset, "bent", *one).draw() for one in wanted]
        with ThreadPoolExecutor(len(wanted)) as pool:
            with occupied(engine._worker):
                asked = [pool.submit(draw, engine, asset, "bent", *one) for one in wanted]
                until(lambda: engine.waiting == len(wanted))
                assert engine._worker.waiting == len(QUERIES)
            together = [future.result(60) for future in asked]

    assert [tile.tobytes() for tile in together] == [tile.tobytes() for tile in alone]


class _Large:
    """What a failing call held."""


@pytest.mark.parametrize("joined", [False, True])
def test_an_error_does_not_keep_what_its_frames_held(joined: bool) -> None:
    """Its memory was given back: it must be free without a collection of cycles."""
    held: list[weakref.ref[_Large]] = []

    def failing(*_: object) -> list[Tile]:
        large = _Large()
        held.append(weakref.ref(large))
        raise LimitError("too large")

    gc.disable()
    try:
        with closing(DeviceWorker(4)) as worker:
            batcher = TileBatcher(worker, nullcontext)
            with suppress(LimitError):
                batcher.tile("key", ADDRESSES[0], 64, failing) if joined else worker.call(failing)
            gone = held[0]() is None
    finally:
        gc.enable()
    assert gone
