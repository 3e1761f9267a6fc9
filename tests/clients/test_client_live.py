"""Live connections of the clients, over a real socket, on an engine without a device."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

from api import patch
from api.fake_engine import FakeEngine
from api.live import serving
from rhytid_client import (
    AsyncClient,
    BadAnswer,
    Client,
    ConnectionFailed,
    LiveAnswer,
    LiveClosed,
    NotFound,
    PlainClient,
    RequestError,
)
from rhytid_client.live.messages import (
    from_half,
    read_answer,
    view_message,
    weights_message,
)
from rhytid_client.requests import Request

TILES = [(1001, 0, 1, 2), (1001, 0, 0, 0)]
# The server's scale of this asset is 0.00675.
HALF_CODE = 1.01 * 0.00675 / 65534
SHAPES = {"jawOpen": patch.smile(0.5), "eyeBlink_L": patch.smile(-0.25)}
URL = "http://127.0.0.1:9"


class Server(NamedTuple):
    url: str
    asset: str


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with serving(FakeEngine()) as http:
        url = str(http.base_url)
        with Client(url) as client:
            made = client.create_asset(
                patch.obj(), name="patch.obj", settings=patch.SETTINGS, shapes=SHAPES
            )
            yield Server(url, client.wait(made).id)


def once(url: str, asset: str, frame: dict[str, Any], **header: Any) -> Any:
    """The tiles of one frame by their addresses, and the answer; of the blocking client."""
    with Client(url) as client, client.live(asset, **header) as live:
        live.send(**frame)
        found = {tile.address: tile for tile in live.receive()}
        return found, live.answer


def once_plain(url: str, asset: str, frame: dict[str, Any], **header: Any) -> Any:
    with PlainClient(url).live(asset, **header) as live:
        live.send(**frame)
        found = {tile.address: tile for tile in live.receive()}
        return found, live.answer


def once_async(url: str, asset: str, frame: dict[str, Any], **header: Any) -> Any:
    async def run() -> Any:
        async with AsyncClient(url) as client, client.live(asset, **header) as live:
            await live.send(**frame)
            found = {tile.address: tile async for tile in live.receive()}
            return found, live.answer

    return asyncio.run(run())


ONCE = pytest.mark.parametrize("call", [once, once_plain, once_async])


@ONCE
@pytest.mark.parametrize(("format", "bound"), [("f32", 0.0), ("f16", 1e-5), ("u16", HALF_CODE)])
def test_tiles_are_those_of_a_call(
    server: Server, call: Callable[..., Any], format: str, bound: float
) -> None:
    frame = {"positions": patch.smile(0.3)}
    found, answer = call(*server, frame, tiles=TILES, format=format, method="binned")
    assert answer == LiveAnswer(0, sent=2, seconds=answer.seconds)
    with Client(server.url) as client:
        tiles = client.tiles(server.asset, patch.smile(0.3), TILES, method="binned")
    for address, tile in zip(TILES, tiles, strict=True):
        assert found[address].frame == 0
        assert np.abs(found[address].array - tile.array).max() <= bound


@ONCE
def test_weights_by_name(server: Server, call: Callable[..., Any]) -> None:
    half = 0.5 * SHAPES["jawOpen"].astype(float) + 0.5 * patch.positions()
    tile, _ = call(*server, {"weights": {"jawOpen": 0.5}, "frame": 9}, tiles=TILES)
    same, _ = call(*server, {"positions": half}, tiles=TILES)
    assert np.abs(tile[TILES[0]].array - same[TILES[0]].array).max() < 1e-6
    listed, answer = call(*server, {"weights": [0.5]}, tiles=TILES, shapes=["JawOpen"])
    assert np.array_equal(listed[TILES[0]].array, tile[TILES[0]].array)
    assert answer.sent == 2


@ONCE
def test_refusals_are_those_of_other_calls(server: Server, call: Callable[..., Any]) -> None:
    frame = {"positions": patch.smile()}
    with pytest.raises(NotFound, match="no asset"):
        call(server.url, "0" * 16, frame, tiles=TILES)
    with pytest.raises(LiveClosed, match="level 12") as closed:
        call(*server, frame, tiles=[(1001, 12, 0, 0)])
    assert (closed.value.code, "levels go" in closed.value.reason) == (4404, True)
    with pytest.raises(RequestError, match=r"422 .*vertex 0 is"):
        call(*server, {"positions": patch.smile() * np.nan}, tiles=TILES)
    with pytest.raises(LiveClosed, match="24 vertices: must be 25"):
        call(*server, {"positions": patch.smile()[1:]}, tiles=TILES)
    with pytest.raises(ConnectionFailed):
        call(URL, server.asset, frame, tiles=TILES)


def test_a_connection_goes_on_after_a_problem_and_looks_elsewhere(server: Server) -> None:
    with Client(server.url) as client, client.live(server.asset, tiles=TILES[:1]) as live:
        assert live.asset.shapes == ("jawOpen", "eyeBlink_L")
        live.send(weights=[np.inf, 0])
        with pytest.raises(RequestError, match="weight of jawOpen is inf"):
            list(live.receive())
        assert live.send(weights=[1, 0], frame=7) == 7
        assert [tile.frame for tile in live.receive()] == [7]
        with pytest.raises(ValueError, match="frame 7 after frame 7"):
            live.send(weights=[1, 0], frame=7)
        assert live.send(weights=[0, 1]) == 8
        assert [tile.frame for tile in live.receive()] == [8]
        live.look(camera=np.diag([2, 2, 0.1, 1.0]) - np.outer([1, 1, 0, 0], [0, 0, 0, 1]), level=1)
        assert {tile.level for tile in live.receive()} == {1}
        live.look(TILES)
        assert len(list(live.receive())) == 2
        assert live.answer is not None
        assert live.answer.frame == 8


def test_asyncio_sends_while_it_receives(server: Server) -> None:
    async def run() -> list[int]:
        client = AsyncClient(server.url)
        async with client, client.live(server.asset, tiles=TILES) as live:
            await live.look(TILES[:1])

            async def send() -> None:
                for number in range(20):
                    await live.send(positions=patch.smile(0.01 * number), frame=2 * number)

            sending, last = asyncio.create_task(send()), [-1]
            while last[-1] < 38:
                last += [tile.frame async for tile in live.receive()]
            await sending
            return last

    frames = asyncio.run(run())
    assert frames == sorted(set(frames))


@pytest.mark.parametrize(
    ("frame", "named"),
    [
        ({}, "either positions or weights"),
        ({"positions": [[0, 0, 0]], "weights": [1]}, "either positions or weights"),
        ({"positions": [0, 0, 0]}, "shape"),
        ({"weights": [1]}, "not .2,."),
        ({"weights": {"jaw": 1}}, "'jaw' is none"),
        ({"weights": [1, 1], "frame": -1}, "numbers must grow"),
    ],
)
def test_what_cannot_be_sent_is_not(server: Server, frame: dict[str, Any], named: str) -> None:
    with Client(server.url) as client, client.live(server.asset, tiles=TILES) as live:
        with pytest.raises(ValueError, match=named):
            live.send(**frame)
        assert live.send(weights=[0, 0]) == 0


def test_what_cannot_be_asked_is_not() -> None:
    client = Client(URL)
    with pytest.raises(ValueError, match="either tiles or camera"):
        client.live("a")
    with pytest.raises(ValueError, match=r"not \(4, 4\)"):
        client.live("a", camera=np.eye(3))
    client._url = "ftp://x"
    with pytest.raises(ValueError, match="no address of http"):
        client.live("a", tiles=TILES)
    assert view_message([(1, 2, 3, 4)]) == '{"message": "view", "tiles": [[1, 2, 3, 4]]}'


@pytest.mark.parametrize("message", [b"", b"\0" * 40, b"\0" * 36 + b"\1" * 4, "{", "[]", "{}"])
def test_messages_that_are_none_are_refused(message: Any) -> None:
    with pytest.raises(BadAnswer):
        read_answer(message, Request("WS", "/"))


def test_half_floats_are_read_as_numpy_does() -> None:
    every = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    pairs = every.reshape(-1, 2)  # ± 0, infinite ones and those below the normal ones, too
    found = from_half(pairs)
    assert (found.dtype, found.shape) == (np.float32, pairs.shape)
    assert (found.view(np.uint32) == pairs.astype(np.float32).view(np.uint32)).all()


@pytest.mark.parametrize(
    ("shapes", "told"),
    [
        (
            ("smile", "eyeBlink_L", "mouthOpen", "jawLeft", "jawOpen"),
            r"closest are jawOpen, jawLeft, mouthOpen; open it with shapes=\[…\]",
        ),
        ((), "the asset has none$"),
    ],
)
def test_a_shape_that_is_not_known_is_told_with_those_that_are_spelt_alike(
    shapes: tuple[str, ...], told: str
) -> None:
    with pytest.raises(ValueError, match=f"'jaw_open' is none of the shapes [^:]*: {told}"):
        weights_message(1, {"jaw_open": 1.0}, shapes)


def test_another_number_of_weights_is_told_with_how_to_name_them() -> None:
    told = r"weights have shape \(1,\), not \(2,\): open it with shapes=\[…\]"
    with pytest.raises(ValueError, match=told):
        weights_message(1, [0.5], ("smile", "jawOpen"))


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.sync.client", None)
    live = Client(URL).live("a", tiles=TILES)
    with pytest.raises(ImportError, match=r"clients/python\[live\]"), live:
        pass
