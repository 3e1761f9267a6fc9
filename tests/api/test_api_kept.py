"""Tiles that the server keeps: the engine is not asked again, and nobody gets an old one."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, npy
from api.live import serving
from api.patch import smile, upload
from engine.engines import running
from processes.served import await_value, children
from rhytid.api import app
from rhytid.api.encoded_tiles import Asked, EncodedTiles, Known
from rhytid.domain.tiles import TileAddress
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.changes import SIZE, Changes
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery
from rhytid.processes.remote_engine import RemoteEngine
from rhytid.support.settings import ServiceSettings

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

TILE = "tiles/1001/0/2/1"
# Versions of a frame, each with tiles of its own.
VERSIONS = 6


@pytest.fixture
def caches(monkeypatch: pytest.MonkeyPatch) -> list[EncodedTiles]:
    """Those of the servers that are made in the test."""
    made: list[EncodedTiles] = []

    def noted(*given: Any) -> EncodedTiles:
        made.append(EncodedTiles(*given))
        return made[-1]

    monkeypatch.setattr(app, "EncodedTiles", noted)
    return made


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path) as found:
        yield found


@contextmanager
def served(engine: Any) -> Iterator[tuple[httpx.Client, str]]:
    """A client, and the path of an asset with the frame `smile`."""
    with serving(engine, key_rate=1_000_000) as client:
        path = f"/v1/assets/{built(client, upload())}"
        put(client, f"{path}/frames/smile", 0)
        yield client, path


def put(client: httpx.Client, frame: str, version: int) -> None:
    content = npy(smile(0.05 + 0.05 * version))
    client.put(frame, content=content, headers=NPY).raise_for_status()


def counting(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of calls for tiles, as they come."""
    calls: list[str] = []

    def noted(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def make(*given: Any) -> Any:
            calls.append(name)
            return call(*given)

        return make

    for name in ("draw", "describe"):
        monkeypatch.setattr(engine.tiles, name, noted(name, getattr(engine.tiles, name)))
    return calls


@pytest.mark.parametrize(("format", "times"), [("npy", 2), ("f16", 2), ("exr", 1), ("png", 1)])
@pytest.mark.parametrize("place", [TILE, "maps/1001"])
def test_a_tile_is_drawn_once_or_twice(
    engine: Engine, format: str, times: int, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(engine) as (client, asset):
        calls = counting(engine, monkeypatch)
        path = f"{asset}/frames/smile/{place}?format={format}"
        first = client.get(path)
        tag = first.headers["etag"]
        for _ in range(2):
            again, head = client.get(path), client.head(path)
            known = client.get(path, headers={"If-None-Match": tag})
            other = client.get(path, headers={"If-None-Match": '"else"'})
            assert again.content == other.content == first.content
            assert (head.status_code, head.content) == (200, b"")
            assert (known.status_code, known.content) == (304, b"")
            for name in ("etag", "content-type", "cache-control", "x-rhytid-scale"):
                assert again.headers.get(name) == first.headers.get(name)
                assert head.headers.get(name) == first.headers.get(name)
            assert "x-rhytid-scale" not in known.headers
        assert calls == ["draw"] * times


def test_a_head_is_remembered(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(engine) as (client, asset):
        calls = counting(engine, monkeypatch)
        path = f"{asset}/frames/smile/{TILE}"
        tags = [client.head(path).headers["etag"] for _ in range(2)]
        assert calls == ["describe"]
        assert client.get(path).headers["etag"] == tags[0] == tags[1]


def test_an_asset_whose_tiles_are_kept_is_in_use(engine: Engine) -> None:
    """Or it would leave for the shared store as one that nobody asks for."""
    with served(engine) as (client, asset):
        id = asset.rpartition("/")[2]
        path = f"{asset}/frames/smile/{TILE}?format=png"
        tag = client.get(path).headers["etag"]
        for headers in ({}, {"If-None-Match": tag}):
            before = time.monotonic()
            assert client.get(path, headers=headers).status_code in (200, 304)
            assert engine.mark(id, "smile").changes.used(id) >= before


def test_what_was_changed_is_drawn_anew(engine: Engine, caches: list[EncodedTiles]) -> None:
    with served(engine) as (client, asset):
        frame = f"{asset}/frames/smile"
        found = [client.get(f"{frame}/{TILE}").content]
        put(client, frame, 1)
        found.append(client.get(f"{frame}/{TILE}").content)
        client.patch(asset, json={"depth": 0.5}).raise_for_status()
        found.append(client.get(f"{frame}/{TILE}").content)
        assert len(set(found)) == 3

        caches[0].clear()
        assert client.get(f"{frame}/{TILE}").content == found[2]
        client.delete(frame).raise_for_status()
        assert client.get(f"{frame}/{TILE}").status_code == 404
        put(client, frame, 1)
        assert client.get(f"{frame}/{TILE}").content == found[2]
        client.delete(asset).raise_for_status()
        assert client.get(f"{frame}/{TILE}").status_code == 404


def test_a_kept_tile_is_not_sent_without_memory_for_it(
    engine: Engine, caches: list[EncodedTiles], monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(engine) as (client, asset):
        path = f"{asset}/frames/smile/{TILE}"
        first = [client.get(path) for _ in range(2)][1]
        calls = counting(engine, monkeypatch)
        monkeypatch.setattr(caches[0]._budget, "taken", lambda *_: None)
        assert client.get(path).content == first.content
        assert calls == ["draw"]


def test_nothing_is_remembered_of_what_was_read_during_a_change() -> None:
    counts = Changes(memoryview(bytearray(SIZE)))
    kept = EncodedTiles(ByteBudget(6400, "RHYTID_HOST_MEMORY_MB"))
    asked = Asked("npy", "a", "smile", MapQuery(), TileAddress(1001, 0, 0, 0))
    with counts.changing("a", "smile"):
        kept.note(asked, Known(counts.mark("a", "smile"), {}, {}))
        assert kept.known(asked, counts.mark("a", "smile")) is None
    kept.note(asked, Known(counts.mark("a", "smile"), {}, {}))
    assert kept.known(asked, counts.mark("a", "smile")) is not None


def race(client: httpx.Client, asset: str, caches: list[EncodedTiles], seconds: float) -> int:
    """Replace a frame again and again while others ask for a tile of it and what is kept is let go.
    Fails where a tile is of a version that was replaced before it was asked for, or of none.
    Returns how often it was asked for."""
    frame = f"{asset}/frames/smile"
    tile = f"{frame}/{TILE}?method=redraw"
    version_of: dict[bytes, int] = {}
    for version in range(VERSIONS):
        put(client, frame, version)
        version_of[client.get(tile).content] = version
    assert len(version_of) == VERSIONS
    begun = stored = VERSIONS - 1
    until = time.monotonic() + seconds

    def write() -> None:
        nonlocal begun, stored
        with httpx.Client(base_url=client.base_url, timeout=60) as own:
            while time.monotonic() < until:
                begun += 1
                put(own, frame, begun % VERSIONS)
                stored = begun
                time.sleep(0.01)

    def read() -> int:
        count = 0
        with httpx.Client(base_url=client.base_url, timeout=60) as own:
            while time.monotonic() < until:
                oldest = stored
                answer = own.get(tile)
                answer.raise_for_status()
                found = version_of[answer.content]
                possible = {version % VERSIONS for version in range(oldest, begun + 1)}
                assert found in possible, f"version {found}, {possible} were stored"
                count += 1
        return count

    def forget() -> None:
        while time.monotonic() < until:
            caches[-1].clear()
            time.sleep(0.003)

    with ThreadPoolExecutor(6) as pool:
        others = [pool.submit(write), pool.submit(forget)]
        readers = [pool.submit(read) for _ in range(4)]
        for other in others:
            other.result()
        return sum(reader.result() for reader in readers)


def test_nobody_gets_an_old_tile(engine: Engine, caches: list[EncodedTiles]) -> None:
    with served(engine) as (client, asset):
        assert race(client, asset, caches, 3.0) > 50


@pytest.mark.slow
def test_nobody_gets_an_old_tile_while_the_process_is_killed(
    tmp_path: Path, caches: list[EncodedTiles]
) -> None:
    settings = replace(ServiceSettings.from_environment(), store=tmp_path)
    before = set(children(os.getpid()))
    with closing(RemoteEngine(settings)) as engine, served(engine) as (client, asset):

        def kill() -> None:
            for _ in range(3):
                time.sleep(3)
                (child,) = set(children(os.getpid())) - before
                os.kill(child, signal.SIGKILL)
                await_value(engine.ready)

        killing = threading.Thread(target=kill)
        killing.start()
        try:
            assert race(client, asset, caches, 14.0) > 50
        finally:
            killing.join()
        assert engine.restarts == {"killed": 3}
