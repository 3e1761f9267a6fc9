"""Connections over real sockets: how many there may be, and what becomes of those that stall."""

from __future__ import annotations

import json
import resource
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from api.fake_engine import FakeEngine
from api.live import serving
from api.test_api_memory import connected, soon, uploading, use
from rhytid.api.server.connections import PROGRESS, ConnectionLimits, LimitedConnection
from rhytid.api.server.listening import allow_files

STALLED = 0.3
MIB = 1 << 20


@pytest.fixture
def client(tmp_path: Path) -> Iterator[httpx.Client]:
    (tmp_path / "partial").mkdir()
    with serving(FakeEngine(), store=tmp_path, stall_seconds=STALLED, connections=6) as client:
        yield client


def rest(connection: socket.socket) -> bytes:
    """All that comes until the connection is closed."""
    connection.settimeout(30)
    found = b""
    while more := connection.recv(1 << 16):
        found += more
    return found


def problem(answer: bytes) -> tuple[int, str]:
    """Status and detail of an answer that is a problem."""
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"Content-Type: application/problem+json" in head
    about = json.loads(body)
    assert head.split()[1] == str(about["status"]).encode()
    return about["status"], about["detail"]


@pytest.mark.parametrize("begun", [b"G", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "])
def test_a_head_that_never_ends_is_refused(client: httpx.Client, begun: bytes) -> None:
    with connected(client) as connection:
        connection.sendall(begun)
        status, detail = problem(rest(connection))
    assert status == 408
    assert "head" in detail
    assert f"{STALLED:g} seconds" in detail


def test_a_head_that_trickles_is_refused(client: httpx.Client) -> None:
    with connected(client) as connection:
        connection.settimeout(0.02)
        for _ in range(1000):
            connection.sendall(b"G")
            try:
                found = connection.recv(1 << 16)
                break
            except TimeoutError:
                pass
    assert problem(found)[0] == 408


def test_a_connection_without_a_request_is_closed(client: httpx.Client) -> None:
    with connected(client) as connection:
        assert rest(connection) == b""


def test_a_head_that_never_ends_after_an_answer_is_closed(client: httpx.Client) -> None:
    with connected(client) as connection:
        connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200 ")
        connection.sendall(b"GET /heal")  # which ends uvicorn's own wait for the next request
        assert b"HTTP/1.1" not in rest(connection)


def test_a_body_that_stops_is_refused_and_given_back(client: httpx.Client) -> None:
    with uploading(client, 3 * MIB, 100 * MIB) as connection:
        status, detail = problem(rest(connection))
    assert status == 408
    assert f"{PROGRESS} bytes" in detail
    soon(lambda: use(client, "spool")["used"] == 0)


def test_a_body_that_trickles_is_refused(client: httpx.Client) -> None:
    with uploading(client, 0, 100 * MIB) as connection:
        connection.settimeout(0.02)
        for _ in range(1000):
            connection.sendall(b"x")
            try:
                found = connection.recv(1 << 16)
                break
            except TimeoutError:
                pass
    assert problem(found)[0] == 408


def test_a_body_that_is_slow_is_taken(client: httpx.Client) -> None:
    body = bytes(2 * PROGRESS)
    with uploading(client, 0, 1 * MIB) as connection:
        began = time.monotonic()
        while time.monotonic() - began < 2 * STALLED:
            connection.sendall(body)
            time.sleep(STALLED / 8)
        connection.setblocking(False)
        with pytest.raises(BlockingIOError):
            connection.recv(1)


def test_a_body_that_goes_on_after_its_refusal_ends(client: httpx.Client) -> None:
    with connected(client) as connection:
        head = "POST /v1/assets HTTP/1.1\r\nHost: evil.example\r\nContent-Length: 1000000\r\n\r\n"
        connection.sendall(head.encode())
        connection.settimeout(0.02)
        found = b""
        for _ in range(1000):
            try:
                connection.sendall(b"x")
                if not (more := connection.recv(1 << 16)):
                    break
                found += more
            except TimeoutError:
                pass
            except ConnectionError:
                break
        else:
            pytest.fail("it goes on")
    assert found.startswith(b"HTTP/1.1 400 ")


def test_one_connection_too_many_is_refused(client: httpx.Client) -> None:
    client.get("/healthz")  # holds one of the three that one address may have
    with ExitStack() as held:
        for _ in range(2):
            held.enter_context(connected(client))
        status, detail = problem(rest(held.enter_context(connected(client))))
        assert (status, "3 connections from this address" in detail) == (503, True)
        assert "RHYTID_CONNECTIONS" in detail
        assert client.get("/healthz").status_code == 200
    with closing(connected(client)) as later:
        soon(lambda: True)
        later.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        assert rest(later).startswith(b"HTTP/1.1 200 ")


def test_addresses_share_what_there_is() -> None:
    def of(host: str) -> Any:
        return SimpleNamespace(client=(host, 1))

    many: Any = SimpleNamespace(limits=ConnectionLimits(1.0, 4), _host=LimitedConnection._host)
    many.client = ("2", 1)
    many.connections = [of("1"), of("1"), of("1"), many]
    assert LimitedConnection._too_many(many) is None
    many.connections.append(of("3"))
    assert "4 connections are open" in (LimitedConnection._too_many(many) or "")


def test_a_proxy_may_have_all_there_is(tmp_path: Path) -> None:
    with serving(FakeEngine(), store=tmp_path, connections=4, proxies=("127.0.0.1",)) as client:
        client.get("/healthz")
        with ExitStack() as held:
            for _ in range(3):
                connection = held.enter_context(connected(client))
                connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200 ")
            status, detail = problem(rest(held.enter_context(connected(client))))
    assert (status, "4 connections are open" in detail) == (503, True)


def test_what_is_no_http_is_told_as_a_problem(client: httpx.Client) -> None:
    for wrong in (b"\x16\x03\x01\r\n\r\n", b"GET / HTTP/1.1\r\nX: " + b"x" * 70_000):
        with connected(client) as connection:
            connection.sendall(wrong)
            try:
                assert problem(rest(connection))[0] == 400
            except ConnectionResetError:  # it was closed before all of it was read
                assert len(wrong) > 16384


def test_there_are_files_for_all_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda kind, limits: given.append(limits))
    for limits in ((1024, 524_288), (1024, 2000), (100_000, 524_288)):
        monkeypatch.setattr(resource, "getrlimit", lambda kind, limits=limits: limits)
        allow_files(1024)
    assert given == [(4352, 524_288), (2000, 2000)]
