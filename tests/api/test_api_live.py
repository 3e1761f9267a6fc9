"""The live connection over a fake engine: what comes in, what goes out, what is refused."""

from __future__ import annotations

import io
import json
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from api.asking import built
from api.fake_engine import FakeEngine
from api.live import serving
from api.live_socket import Speaker, speaking
from api.patch import obj, positions, smile, upload
from rhytid.api.live import session
from rhytid.api.live.places import LivePlaces
from rhytid.engine.tile_plan import TilePlan
from rhytid.errors import BusyError, DeviceLostError, QuotaError

TILE = [1001, 0, 1, 2]
NAMES = ["browInnerUp_L", "browInnerUp_R", "jawOpen"]


class GatedEngine(FakeEngine):
    """A fake engine that draws while `gate` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = threading.Event()
        self.gate.set()
        self.began = threading.Semaphore(0)
        self.error: Exception | None = None
        self.drawing, self.most = 0, 0
        plans_once = self.tiles.plans_once

        def gated(*arguments: Any) -> list[TilePlan]:
            if self.error is not None:
                raise self.error
            return [replace(plan, draw=self._gated(plan)) for plan in plans_once(*arguments)]

        self.tiles.plans_once = gated  # type: ignore[method-assign]

    def _gated(self, plan: TilePlan) -> Any:
        def draw() -> Any:
            self.drawing += 1
            self.most = max(self.most, self.drawing)
            self.began.release()
            try:
                assert self.gate.wait(10)
                return plan.draw()
            finally:
                self.drawing -= 1

        return draw


@pytest.fixture(scope="module")
def engine() -> GatedEngine:
    return GatedEngine()


@pytest.fixture(scope="module")
def server(engine: GatedEngine) -> Iterator[httpx.Client]:
    with serving(engine) as client:
        yield client


def shapes() -> Any:
    """(3, 25, 3) what the named shapes of the asset do."""
    moves = np.zeros((3, 25, 3), np.float32)
    moves[0, :12, 2], moves[1, 12:, 2], moves[2, :, 1] = 0.25, 0.5, -0.125
    return positions() + moves


def packed() -> bytes:
    file = io.BytesIO()
    np.savez(file, shapes=shapes(), names=np.array(NAMES))
    return file.getvalue()


@pytest.fixture(scope="module")
def asset(server: httpx.Client) -> str:
    return built(server, {**upload(), "shapes": ("shapes.npz", packed())})


@pytest.fixture(scope="module")
def plain(server: httpx.Client) -> str:
    """An asset without shapes."""
    return built(server, upload(depth=0.125))


@pytest.fixture
def speaker(engine: GatedEngine, server: httpx.Client, asset: str) -> Iterator[Speaker]:
    with speaking(server, asset) as found:
        yield found
    engine.gate.set()


def drawn(server: httpx.Client, asset: str, frame: Any, tile: str = "1001/0/1/2") -> Any:
    """The tile of positions by the call that needs no connection."""
    kind = {"Content-Type": "application/octet-stream"}
    path = f"/v1/assets/{asset}/tiles?tile={tile}&format=f16&method=binned"
    answer = server.post(path, content=np.asarray(frame, "<f4").tobytes(), headers=kind)
    body = answer.raise_for_status().content.partition(b"\r\n\r\n")[2]
    return np.frombuffer(body[: 2 * 64 * 64], "<f2").reshape(64, 64)


def test_positions_in_tiles_out(server: httpx.Client, asset: str, speaker: Speaker) -> None:
    ready = speaker.open(tiles=[TILE, [1001, 1, 0, 0]], method="binned")
    assert (ready["vertices"], ready["tile_size"], ready["udims"]) == (25, 64, [1001])
    speaker.positions(7, smile())
    tiles, end = speaker.answer()
    assert [tile.address for tile in tiles] == [tuple(TILE), (1001, 1, 0, 0)]
    assert {(t.frame, t.codes, t.dropped, t.values.shape) for t in tiles} == {(7, 1, 0, (64, 64))}
    assert np.array_equal(tiles[0].values.astype("<f2"), drawn(server, asset, smile()))
    assert {**end, "seconds": 0} == {
        "message": "frame", "frame": 7, "sent": 2, "unchanged": 0, "dropped": 0, "seconds": 0,
    }  # fmt: skip


def test_nothing_is_stored(server: httpx.Client, asset: str, speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    speaker.positions(1, smile())
    speaker.answer()
    frames = server.get(f"/v1/assets/{asset}/frames").json()
    assert [frame["name"] for frame in frames] == ["neutral"]


@pytest.mark.parametrize(("format", "scale"), [("f16", None), ("u16", None), ("u16", 0.5)])
def test_formats_hold_the_same(
    server: httpx.Client, asset: str, speaker: Speaker, format: str, scale: float | None
) -> None:
    speaker.open(tiles=[TILE], method="binned", format=format, scale=scale)
    speaker.positions(1, smile())
    (tile,), _ = speaker.answer()
    exact = drawn(server, asset, smile()).astype(float)
    if format == "f16":
        assert np.array_equal(tile.values, exact)
        return
    assert tile.scale == np.float32(scale or tile.scale)
    found = (tile.values.astype(float) - 32768) / 32767 * tile.scale
    assert tile.values.min() < 32768
    assert np.abs(found - exact).max() <= tile.scale / 65534 + np.abs(exact).max() / 2048


# The weights of ARKit: one name without a side, one that the asset has not, another spelling.
ARKIT = ["browInnerUp", "tongueOut", "JawOpen"]


def test_weights_move_the_shapes_that_their_names_mean(
    server: httpx.Client, asset: str, speaker: Speaker
) -> None:
    ready = speaker.open(tiles=[TILE], method="binned", shapes=ARKIT)
    assert (ready["shapes"], ready["unknown"]) == (ARKIT, ["tongueOut"])
    speaker.weights(1, [0.5, 9.0, 0.25])
    (tile,), _ = speaker.answer()
    moves = shapes().astype(float) - positions()
    frame = positions() + np.tensordot([0.5, 0.5, 0.25], moves, 1)
    assert np.array_equal(tile.values.astype("<f2"), drawn(server, asset, frame))


def test_weights_are_in_the_order_of_the_shapes_unless_they_are_named(speaker: Speaker) -> None:
    assert speaker.open(tiles=[TILE])["shapes"] == NAMES
    speaker.weights(1, [0, 0, np.nan])
    _, end = speaker.answer()
    assert (end["message"], end["frame"], end["status"]) == ("problem", 1, 422)
    assert "jawOpen" in end["detail"]
    speaker.weights(2, [0, 0, 1])
    assert speaker.answer()[1]["sent"] == 1


def test_a_vertex_that_is_not_finite_is_named_and_the_connection_goes_on(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    frame = smile()
    frame[3, 1] = np.inf
    speaker.positions(1, frame)
    tiles, end = speaker.answer()
    assert (tiles, end["type"]) == ([], "urn:rhytid:problem:frame")
    assert "vertex 3" in end["detail"]
    speaker.positions(2, smile())
    assert speaker.answer()[1]["frame"] == 2


def test_only_the_newest_frame_is_drawn_and_the_dropped_are_counted(
    engine: GatedEngine, speaker: Speaker
) -> None:
    speaker.open(tiles=[TILE])
    engine.began = threading.Semaphore(0)
    engine.gate.clear()
    speaker.positions(1, smile(0.1))
    assert engine.began.acquire(timeout=10)
    for number in (2, 3, 4, 9):
        speaker.positions(number, smile(0.1 * number))

    pong = speaker.socket.ping()
    assert pong.wait(10)
    engine.gate.set()
    first, second = speaker.answer(), speaker.answer()
    assert (first[1]["frame"], first[1]["dropped"]) == (1, 0)
    assert (second[1]["frame"], second[1]["dropped"]) == (9, 3)
    assert [tile.dropped for tile in second[0]] == [3]


def test_a_connection_asks_the_engine_for_one_tile_at_a_time() -> None:
    engine = GatedEngine()
    with serving(engine) as client:
        asset = built(client, upload())
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[[1001, 0, 0, column] for column in range(4)])
            for number in range(50):
                speaker.positions(number, smile(0.01 * number))
            while speaker.answer()[1]["frame"] < 49:
                assert engine.most == 1


class Paused:
    """Lets three messages through, and others once it is told to."""

    def __init__(self) -> None:
        self.left, self.go = 3, threading.Event()

    def take(self, *_: Any) -> int:
        self.left -= 1
        return int(self.left < 0 and not self.go.is_set())


def test_who_sends_too_often_is_read_later(
    server: httpx.Client, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    paused = Paused()
    monkeypatch.setattr(session, "Rates", lambda: paused)
    with speaking(server, asset) as speaker:
        speaker.open(tiles=[TILE])
        for number in range(1, 6):
            speaker.positions(number, smile(0.01 * number))
        while speaker.answer()[1]["frame"] < 4:
            pass
        with pytest.raises(TimeoutError):
            speaker.socket.recv(0.05)
        paused.go.set()
        assert speaker.answer()[1]["frame"] == 5


def test_a_tile_that_changed_too_little_is_not_sent_again(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE, [1001, 0, 0, 0]], tolerance=1e-4)
    speaker.positions(0, smile(0.1))
    first, end = speaker.answer()
    assert (end["sent"], end["unchanged"]) == (2, 0)
    # Slowly: each step is below the tolerance, their sum is not.
    found = []
    for number in range(1, 9):
        speaker.positions(number, smile(0.1 + 0.05 * number))
        tiles, end = speaker.answer()
        assert end["sent"] == len(tiles) == 2 - end["unchanged"]
        found += [tile for tile in tiles if tile.address == first[0].address]
    assert 0 < len(found) < 7
    for before, after in zip([first[0], *found], found, strict=False):
        assert np.abs(after.values - before.values).max() > 1e-4


def test_a_frame_that_is_as_before_sends_nothing(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    for number, sent in ((1, 1), (2, 0)):
        speaker.positions(number, smile())
        assert speaker.answer()[1]["sent"] == sent


def test_a_changed_view_is_answered_with_what_is_new_in_it(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    speaker.tell("view", tiles=[TILE, [1001, 0, 0, 0]])  # no frame yet: no answer
    speaker.positions(1, smile())
    assert speaker.answer()[1]["sent"] == 2
    speaker.tell("view", tiles=[[1001, 0, 3, 3], TILE])
    tiles, end = speaker.answer()
    assert [tile.address for tile in tiles] == [(1001, 0, 3, 3)]
    assert (end["frame"], end["unchanged"]) == (1, 1)


def test_a_camera_chooses_the_tiles(speaker: Speaker) -> None:
    # Orthographic: the left half of the patch fills the picture.
    matrix = [[4, 0, 0, -1], [0, 2, 0, -1], [0, 0, 0.1, 0], [0, 0, 0, 1]]
    speaker.open(camera={"matrix": matrix, "level": 0})
    speaker.positions(1, positions())
    tiles, _ = speaker.answer()
    assert {tile.address[3] for tile in tiles} == {0, 1, 2}  # columns: u up to 0.5, with a margin
    # From behind nothing is seen, unless both sides are.
    matrix[0] = [-4.0, 0, 0, 1]
    speaker.tell("view", camera={"matrix": matrix})
    assert speaker.answer()[1]["sent"] == 0
    speaker.tell("view", camera={"matrix": matrix, "two_sided": True})
    assert speaker.answer()[1]["sent"] > 0


def test_a_camera_looks_where_the_mesh_was_sent(server: httpx.Client) -> None:
    """The mesh is far from the origin, and moved there by the server."""
    far = np.array([3000.0, 0.0, 0.0])
    moved = positions().astype(float) * 1.001 + far
    lines = obj().decode().splitlines()
    rest = [line for line in lines if not line.startswith("v ")]
    vertices = [f"v {x:.15g} {y:.15g} {z:.15g}" for x, y, z in moved]
    asset = built(server, upload("\n".join([*vertices, *rest]).encode()))
    assert any(server.get(f"/v1/assets/{asset}").json()["centre"])
    matrix = np.array([[4, 0, 0, -1], [0, 2, 0, -1], [0, 0, 0.1, 0], [0, 0, 0, 1.0]])
    matrix[:, 3] -= matrix[:, :3] @ far
    with speaking(server, asset) as speaker:
        speaker.open(camera={"matrix": matrix.tolist()})
        speaker.positions(1, moved)
        tiles, _ = speaker.answer()
    assert {tile.address[3] for tile in tiles} == {0, 1, 2}


def test_what_was_sent_is_not_what_the_engine_draws_into_next() -> None:
    engine = GatedEngine()
    place = np.empty((64, 64), np.float32)
    gated = engine._gated

    def reusing(plan: TilePlan) -> Any:
        def draw() -> Any:
            place[:] = gated(plan)()
            return place

        return draw

    engine._gated = reusing  # type: ignore[method-assign]
    with serving(engine) as client:
        asset = built(client, upload())
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[TILE])
            for number in (1, 2):
                speaker.positions(number, smile(0.1 * number))
                assert speaker.answer()[1]["sent"] == 1


BAD_HEADERS = {
    "not JSON": "{",
    "key 'method' occurs twice": '{"message": "open", "method": "x", "method": "y"}',
    "message": {"tiles": [TILE]},
    "either tiles or camera": {"message": "open"},
    "tiles.0": {"message": "open", "tiles": [[1001, 0, 1]]},
    "tiles.0.2": {"message": "open", "tiles": [[1001, 0, -1, 0]]},
    "twice": {"message": "open", "tiles": [TILE, TILE]},
    "method 'best'": {"message": "open", "tiles": [TILE], "method": "best"},
    "format": {"message": "open", "tiles": [TILE], "format": "exr"},
    "scale is of the format u16": {"message": "open", "tiles": [TILE], "scale": 1.0},
    "tolerance": {"message": "open", "tiles": [TILE], "tolerance": -1},
    "speed": {"message": "open", "tiles": [TILE], "speed": 1},
    "camera.matrix": {"message": "open", "camera": {"matrix": [[1, 0, 0, 0]]}},
    "none of the shapes": {"message": "open", "tiles": [TILE], "shapes": ["tongueOut"]},
}


@pytest.mark.parametrize("named", BAD_HEADERS)
def test_a_wrong_header_is_named(speaker: Speaker, named: str) -> None:
    header = BAD_HEADERS[named]
    speaker.socket.send(header if isinstance(header, str) else json.dumps(header))
    code, reason = speaker.closed()
    assert (code, named in reason) == (4400, True), reason


@pytest.mark.parametrize(
    ("tile", "named"),
    [([1002, 0, 0, 0], "UDIMs 1001"), ([1001, 9, 0, 0], "levels go from 0 to 8"),
     ([1001, 0, 4, 0], "row 4")],
)  # fmt: skip
def test_a_tile_that_there_is_not_is_named(speaker: Speaker, tile: Any, named: str) -> None:
    speaker.tell("open", tiles=[TILE, tile])
    code, reason = speaker.closed()
    assert (code, named in reason) == (4404, True), reason


def frame(number: int = 5, kind: int = 1, count: int = 25, nbytes: int = 300) -> bytes:
    return struct.pack("<QII", number, kind, count) + bytes(nbytes)


@pytest.mark.parametrize(
    ("message", "code", "named"),
    [
        (b"short", 4400, "5 bytes"),
        (frame(kind=3), 4400, "kind 3"),
        (frame(count=24), 4400, "24 vertices: must be 25"),
        (frame(nbytes=299), 4400, "299 bytes"),
        (frame(kind=2, count=2, nbytes=8), 4400, "2 weights: must be 3"),
        (frame(number=4), 4409, "frame 4 came after frame 4"),
        (frame(number=3), 4409, "numbers must grow"),
        ('{"message": "view"}', 4400, "view: "),
        ('{"message": "view", "tiles": [[1, 0, 0, 0]]}', 4404, "UDIM"),
    ],
)
def test_a_wrong_message_is_named(speaker: Speaker, message: Any, code: int, named: str) -> None:
    speaker.open(tiles=[TILE])
    speaker.positions(4, smile())
    speaker.socket.send(message)
    found, reason = speaker.closed()
    assert (found, named in reason) == (code, True), reason


def test_weights_of_an_asset_without_shapes_are_refused(server: httpx.Client, plain: str) -> None:
    with speaking(server, plain) as speaker:
        assert "shapes" not in speaker.open(tiles=[TILE])
        speaker.weights(1, [1.0])
        assert speaker.closed() == (4400, "frame 1 has weights, the asset no named shapes")
    with speaking(server, plain) as speaker:
        speaker.tell("open", tiles=[TILE], shapes=["jawOpen"])
        assert speaker.closed()[0] == 4404


def test_the_first_message_must_be_the_header(speaker: Speaker) -> None:
    speaker.positions(1, smile())
    assert speaker.closed()[0] == 4400


def test_a_message_above_the_limit_is_not_read(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    with suppress(ConnectionClosed):  # it may be refused before it is sent
        speaker.socket.send(bytes((16 << 20) + 1))
    # What is left of the message may make the system end the connection before the code is read.
    assert speaker.closed()[0] in (1009, 1006)


def test_more_texels_than_a_connection_may_have(
    speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.api.live.drawing.MOST_TEXELS", 4096)
    speaker.tell("open", tiles=[TILE, [1001, 0, 0, 0]])
    assert speaker.closed() == (4413, "8192 texels in view: at most 4096")


def test_an_asset_that_is_deleted_ends_the_connection(server: httpx.Client) -> None:
    asset = built(server, upload(depth=0.0625))
    with speaking(server, asset) as speaker:
        speaker.open(tiles=[TILE])
        server.delete(f"/v1/assets/{asset}").raise_for_status()
        speaker.positions(1, smile())
        code, reason = speaker.closed()
        assert (code, asset in reason) == (4404, True)


def test_a_device_that_is_busy_is_told_and_the_connection_goes_on(
    engine: GatedEngine, speaker: Speaker
) -> None:
    speaker.open(tiles=[TILE])
    engine.error = DeviceLostError("it is restarted")
    try:
        speaker.positions(1, smile())
        _, end = speaker.answer()
    finally:
        engine.error = None
    assert (end["status"], end["retry_after"], end["frame"]) == (503, 5, 1)
    assert end["detail"] == "it is restarted"
    speaker.positions(2, smile())
    assert speaker.answer()[1]["sent"] == 1


def test_a_client_that_says_nothing_is_let_go(
    speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "IDLE", 0.05)
    speaker.open(tiles=[TILE])
    assert speaker.closed() == (4408, "nothing came for 0.05 seconds")


def test_a_header_is_not_waited_for_long(
    server: httpx.Client, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "HEADER", 0.05)
    with speaking(server, asset) as speaker:
        assert speaker.closed() == (4408, "nothing came for 0.05 seconds")


def test_memory_is_held_while_it_is_open_and_no_longer(
    engine: GatedEngine, server: httpx.Client, asset: str
) -> None:
    before = engine.memory.used
    with speaking(server, asset) as speaker:
        speaker.open(tiles=[TILE])
        assert engine.memory.used >= before + 2 * 4 * 64 * 64
        little = engine.memory.used
        speaker.tell("view", tiles=[[1001, 0, row, 0] for row in range(4)])
        speaker.positions(1, smile())
        speaker.answer()
        assert engine.memory.used == little + 4 * 4 * 64 * 64
    for _ in range(200):
        if engine.memory.used == before:
            return
        threading.Event().wait(0.01)
    assert engine.memory.used == before


def refused(server: httpx.Client, asset: str, status: int, **options: Any) -> str:
    with pytest.raises(InvalidStatus) as raised, speaking(server, asset, **options):
        pass
    answer = raised.value.response
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    return str(json.loads(answer.body)["detail"])


def test_what_is_refused_before_there_is_a_connection(
    server: httpx.Client, asset: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert "no asset" in refused(server, "0" * 16, 404)
    assert "rhytid.live.1" in refused(server, asset, 422, subprotocols=["rhytid.live.9"])
    assert "evil.example" in refused(server, asset, 403, origin="http://evil.example")
    assert "'key'" in refused(server, asset, 422, query="?key=secret")
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def test_a_client_need_not_name_the_format(server: httpx.Client, asset: str) -> None:
    with speaking(server, asset, subprotocols=None) as speaker:
        assert speaker.socket.subprotocol is None
    with speaking(server, asset) as speaker:
        assert speaker.socket.subprotocol == "rhytid.live.1"


def test_an_asset_that_builds_is_refused() -> None:
    with serving(FakeEngine(polls=1000)) as client:
        made = client.post("/v1/assets", files=upload()).raise_for_status().json()
        assert "still building" in refused(client, made["id"], 409)


def test_the_end_of_the_server_is_told() -> None:
    with serving(FakeEngine()) as client:
        asset = built(client, upload())
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[TILE])
            client.stop()
            assert speaker.closed()[0] == 1012


def test_places_are_counted_by_caller_and_in_all() -> None:
    places = LivePlaces(most=3, most_each=2)
    with places.one("a"), places.one("a"):
        with pytest.raises(QuotaError, match="a has 2"), places.one("a"):
            pass
        with places.one("b"), pytest.raises(BusyError, match="3 live"), places.one("c"):
            pass
        with places.one("c"):
            assert len(places) == 3
    assert len(places) == 0
