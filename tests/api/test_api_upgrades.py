"""WebSocket upgrades that never become a connection: each ends, with a problem where one can be
read."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.asking import built
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from api.test_api_connections import STALLED, problem, rest
from api.test_api_draining import running
from api.test_api_memory import connected, soon
from live.gated import TILE
from live.speaker import speaking
from rhytid.errors import NotFoundError

ASSET = "0123456789abcdef" * 2
OFFER = (
    "Host: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)


def upgrade(*more: str, path: str = f"/v1/assets/{ASSET}/live", method: str = "GET") -> bytes:
    """The head of an upgrade, with more lines."""
    lines = "".join(f"{line}\r\n" for line in more)
    return f"{method} {path} HTTP/1.1\r\n{OFFER}{lines}\r\n".encode()


@pytest.fixture
def client(tmp_path: Path) -> Iterator[httpx.Client]:
    with serving(FakeEngine(), store=tmp_path, connections=6) as client:
        yield client


@pytest.mark.parametrize(
    "line", ["Content-Length: 5", "Content-Length: 0", "Transfer-Encoding: chunked"]
)
def test_an_upgrade_with_a_body_is_refused_at_once(client: httpx.Client, line: str) -> None:
    with connected(client) as connection:
        connection.sendall(upgrade(line))
        status, detail = problem(rest(connection))
    assert (status, "upgrade" in detail) == (400, True), detail


@pytest.mark.parametrize(
    "head",
    [upgrade(*(f"X-{i}: 1" for i in range(200))), upgrade("X: " + "x" * 9000)],
    ids=["many headers", "a long header"],
)  # fmt: skip
def test_an_upgrade_that_the_parser_of_websockets_refuses_ends(
    client: httpx.Client, head: bytes
) -> None:
    with connected(client) as connection:
        connection.sendall(head)
        assert problem(rest(connection))[0] == 400


@pytest.mark.parametrize("path", ["/", "/nowhere", "/v1/assets", f"/v1/assets/{ASSET}/live?x=1"])
def test_an_upgrade_that_no_route_takes_ends(client: httpx.Client, path: str) -> None:
    with connected(client) as connection:
        connection.sendall(upgrade(path=path))
        assert rest(connection).split()[1] in (b"403", b"404", b"422")


def test_a_handshake_that_is_never_accepted_ends(tmp_path: Path) -> None:
    engine: Any = FakeEngine()
    go, asked = threading.Event(), threading.Event()

    def info(_: str) -> None:
        asked.set()
        go.wait(60)
        raise NotFoundError("no asset")

    engine.assets.info = info
    with serving(engine, store=tmp_path, stall_seconds=STALLED) as client:
        try:
            with connected(client) as connection:
                connection.sendall(upgrade())
                assert asked.wait(30)
                status, detail = problem(rest(connection))
        finally:
            go.set()
    assert (status, f"{STALLED:g} seconds" in detail) == (503, True), detail


def test_a_handshake_that_is_accepted_stays(tmp_path: Path) -> None:
    with (
        serving(FakeEngine(), store=tmp_path, stall_seconds=STALLED) as client,
        speaking(client, built(client, upload())) as speaker,
    ):
        speaker.open(tiles=[TILE])
        time.sleep(2 * STALLED)
        speaker.positions(1, smile())
        assert speaker.answer()[1]["message"] == "frame"


def test_many_of_them_leave_room(client: httpx.Client) -> None:
    with ExitStack() as held:
        for _ in range(20):
            connection = held.enter_context(connected(client))
            connection.sendall(upgrade("Content-Length: 5"))
            assert problem(rest(connection))[0] in (400, 503)
        soon(lambda: client.get("/healthz").status_code == 200)


def test_the_server_ends_beside_one(caplog: pytest.LogCaptureFixture) -> None:
    with running(1) as slow:
        address = (slow.client.base_url.host, slow.client.base_url.port or 0)
        with socket.create_connection(address) as connection:
            connection.sendall(upgrade("Content-Length: 5"))
            soon(lambda: slow.client.get("/healthz").status_code == 200)
            slow.end()
            assert slow.ended.wait(30)
    assert not [record for record in caplog.records if record.exc_info]
