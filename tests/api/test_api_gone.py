"""Drawing stops when its client is gone, through a real server."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.live import serving
from api.test_api_memory import use
from engine.engines import built, new_asset, running
from engine.test_engine_together import until
from rhytid.api import admission
from rhytid.device.launches import DrawingPace
from rhytid.engine.engine import Engine
from rhytid.engine.tiles.maps import MapDrawing

METHODS = ("redraw", "binned", "convolved")


class Held:
    """A device that takes one step of drawing whenever it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.steps, self.free = 0, threading.Semaphore(0)
        self.held = False
        monkeypatch.setattr("rhytid.device.launches.PIECE_SECONDS", 1e-6)
        monkeypatch.setattr(DrawingPace, "took", lambda *_: None)
        monkeypatch.setattr(admission, "_EVERY", 0.0)

    def hold(self, engine: Engine, monkeypatch: pytest.MonkeyPatch, asset: str) -> None:
        """From now on, steps of the asset wait to be let go."""
        self.held = True
        run = engine._worker._run

        def stepwise(task: Any, turn: Any, *, block: bool) -> Any:
            def step() -> Any:
                if self.held and turn == asset:
                    self.steps += 1
                    assert self.free.acquire(timeout=60)
                return task()

            return run(step, turn, block=block)

        monkeypatch.setattr(engine._worker, "_run", stepwise)

    def let_go(self) -> None:
        self.held = False
        self.free.release(1000)


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path) as engine:
        yield engine


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Held:
    return Held(monkeypatch)


def heavy(engine: Engine) -> str:
    """An asset of one tile of 16 blocks, of which nothing is kept on the device."""
    asset = built(engine, new_asset(tile_size=256))
    resident = engine._on_device.loaded(engine.assets._assets.get(asset))
    engine._on_device.run(resident.mesh.cache.clear)
    return asset


def asked(client: httpx.Client, path: str) -> socket.socket:
    """A connection over which a request was sent."""
    connection = socket.create_connection((client.base_url.host, client.base_url.port or 80))
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return connection


def at_rest(engine: Engine, client: httpx.Client) -> bool:
    held = {
        (one, purpose): n
        for one in ("host", "small")
        for purpose, n in use(client, one)["purposes"].items()
    }
    held.pop(("small", "encoded"))  # tiles that are kept
    return engine.waiting == 0 and not any(held.values())


@pytest.mark.parametrize("place", ["tiles/1001/0/0/0", "maps/1001"])
@pytest.mark.parametrize("method", METHODS)
def test_drawing_stops_when_the_client_is_gone(
    engine: Engine, held: Held, monkeypatch: pytest.MonkeyPatch, method: str, place: str
) -> None:
    asset = heavy(engine)
    before = engine._device.budget.used
    path = f"/v1/assets/{asset}/frames/neutral/{place}?method={method}"
    with serving(engine) as client:
        held.hold(engine, monkeypatch, asset)
        connection = asked(client, path)
        until(lambda: held.steps == 1)
        held.free.release(2)
        until(lambda: held.steps == 3)
        connection.close()
        until(lambda: client.get("/healthz").status_code == 200)  # the server has seen it close
        held.free.release(3)
        until(lambda: at_rest(engine, client))
        # What was begun, and where buffers were made in steps, one that gives them back.
        assert held.steps <= 5
        held.let_go()
        assert engine._on_device.run(lambda: engine._device.budget.used) <= before + _kept(engine)
        drawn = client.get(path)
        assert drawn.status_code == 200
    assert engine.memory.used == 0


def _kept(engine: Engine) -> int:
    """Bytes of stretch, scales and the like, which stay whoever asked for them."""
    return 4 * 256**2


def test_what_others_wait_for_is_drawn_to_its_end(
    engine: Engine, held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = heavy(engine)
    path = f"/v1/assets/{asset}/frames/neutral/tiles/1001/0/0/0?method=redraw"
    drawings, square = [], MapDrawing.square

    def spy(maps: MapDrawing, *about: Any) -> Any:
        drawings.append(1)
        return square(maps, *about)

    monkeypatch.setattr(MapDrawing, "square", spy)
    with serving(engine) as client, ThreadPoolExecutor(1) as pool:
        held.hold(engine, monkeypatch, asset)
        connection = asked(client, path)
        until(lambda: held.steps == 1)
        other = pool.submit(client.get, path)
        until(lambda: engine.tiles.joined == 1)
        connection.close()
        held.let_go()
        assert other.result(60).status_code == 200
        until(lambda: at_rest(engine, client))
    assert drawings == [1]  # by whoever asked first


def test_who_joined_and_is_gone_does_not_stop_the_others(
    engine: Engine, held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = heavy(engine)
    path = f"/v1/assets/{asset}/frames/neutral/tiles/1001/0/0/0?method=redraw"
    with serving(engine) as client, ThreadPoolExecutor(1) as pool:
        held.hold(engine, monkeypatch, asset)
        first = pool.submit(client.get, path)
        until(lambda: held.steps == 1)
        connection = asked(client, path)
        until(lambda: engine.tiles.joined == 1)
        connection.close()
        until(lambda: engine.tiles.joined == 0)
        held.let_go()
        assert first.result(60).status_code == 200
        until(lambda: at_rest(engine, client))
