"""What a live connection refuses, and what ends it."""

from __future__ import annotations

import json
import struct
from contextlib import suppress
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from api.asking import built
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from live.gated import TILE
from live.speaker import Speaker, speaking
from rhytid.api.admission import LivePlaces
from rhytid.api.live import session
from rhytid.api.live.wire import LiveClosed, read_opening
from rhytid.errors import BusyError, QuotaError

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
    "closest to tongueOut are": {"message": "open", "tiles": [TILE], "shapes": ["tongueOut"]},
}


@pytest.mark.parametrize("named", BAD_HEADERS)
def test_a_wrong_header_is_named(speaker: Speaker, named: str) -> None:
    header = BAD_HEADERS[named]
    speaker.socket.send(header if isinstance(header, str) else json.dumps(header))
    code, reason = speaker.closed()
    assert (code, named in reason) == (4400, True), reason


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ({"message": None}, "message is None: must be 'open'"),
        ({"speed": 1}, "unknown key speed"),
        ({"camera": {}}, "camera.matrix is missing"),
        ({"tiles": [[1001, 0, 1]]}, "tiles.0.3 is missing"),
        ({"tiles": [[1001, 0, -1, 0]]}, "tiles.0.2 is -1: must be greater than or equal to 0"),
        ({"tiles": []}, "tiles is []: List should have at least 1 item, not 0"),
        ({"tiles": [TILE, TILE]}, "tiles names a tile twice"),
        ({"tiles": None}, "must have either tiles or camera"),
        ({"format": "exr"}, "format is 'exr': must be 'f32', 'f16' or 'u16'"),
        ({"tolerance": "0"}, "tolerance is '0': must be a valid number"),
        ({"scale": True, "format": "u16"}, "scale is True: must be a valid number"),
        ({"tolerance": -1}, "tolerance is -1: must be greater than or equal to 0"),
        ({"tolerance": "n" * 999}, f"tolerance is '{'n' * 23}…: must be a valid number"),
    ],
)
def test_a_header_is_refused_with_the_place_and_the_value(
    part: dict[str, Any], reason: str
) -> None:
    header = {"message": "open", "tiles": [TILE], **part}
    with pytest.raises(LiveClosed) as closed:
        read_opening(json.dumps(header))
    assert (closed.value.code, closed.value.reason[:8]) == (4400, "header: ")
    assert closed.value.reason[8:].startswith(reason)


def test_a_header_is_an_object() -> None:
    with pytest.raises(LiveClosed, match=r"^header: must be a JSON object$"):
        read_opening("[1]")


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
        (
            frame(kind=2, count=2, nbytes=8),
            4400,
            "2 weights: must be 3, or name yours as shapes in the header",
        ),
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


def test_a_message_above_what_the_asset_can_use_is_not_read(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    # Its head alone, so that the server reads no more and the code arrives.
    speaker.socket.socket.sendall(b"\x82\xff" + struct.pack(">Q", (1 << 20) + 1) + bytes(4))
    code, reason = speaker.closed()
    assert (code, str(1 << 20) in reason) == (1009, True), reason
