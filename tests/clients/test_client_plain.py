"""The client without httpx: headers, addresses, servers that are not there or break off."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread

import pytest

from rhytid_client import BadAnswer, ConnectionFailed, PlainClient

WITHOUT = """
import sys
sys.modules["httpx"] = None
import rhytid_client
rhytid_client.PlainClient()
try:
    rhytid_client.Client
except ImportError:
    print("only the client over httpx is missing")
"""


@contextmanager
def answering(answer: bytes) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """The address of a server that reads one request and sends `answer`; and what it read."""
    seen: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            taken, _ = server.accept()
            with taken:
                seen.append(taken.recv(1 << 16))
                taken.sendall(answer)

        thread = Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", lambda: seen[0]
        thread.join()


def test_needs_no_httpx() -> None:
    run = [sys.executable, "-c", WITHOUT]
    out = subprocess.run(run, check=True, capture_output=True, text=True).stdout
    assert out == "only the client over httpx is missing\n"


def test_sends_its_headers() -> None:
    answer = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"
    with answering(answer) as (url, seen):
        client = PlainClient(f"{url}/below/", headers={"Authorization": "Bearer secret"})
        assert client.health() is True
        head = seen()
    assert head.startswith(b"GET /below/healthz HTTP/1.1\r\n")
    assert b"\r\nAuthorization: Bearer secret\r\n" in head


def test_follows_no_redirection() -> None:
    answer = b"HTTP/1.1 302 Found\r\nLocation: http://elsewhere.test/\r\nContent-Length: 0\r\n\r\n"
    with answering(answer) as (url, _), pytest.raises(BadAnswer, match="status 302"):
        PlainClient(url).health()


@pytest.mark.parametrize(
    "answer", [b"", b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n{}", b"no HTTP\r\n\r\n"]
)
def test_an_answer_that_breaks_off(answer: bytes) -> None:
    with answering(answer) as (url, _), pytest.raises(ConnectionFailed):
        PlainClient(url).health()


def test_nobody_is_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(ConnectionFailed, match="GET /healthz"):
        PlainClient(url).health()


@pytest.mark.parametrize(
    "url", ["127.0.0.1:8717", "ftp://a", "http://", "http://a:b", "http://a?b"]
)
def test_what_is_no_address(url: str) -> None:
    with pytest.raises(ValueError, match=r"address|[Pp]ort"):
        PlainClient(url)
