"""Pings of a client that does not read, and pings that it does not answer."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from rhytid.api.server import web_sockets
from rhytid.api.server.web_sockets import OPTIONS, WebSockets

HANDSHAKE = (
    b"GET /live HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def ping(content: bytes) -> bytes:
    """A ping as clients send it, masked with zeros."""
    return bytes([0x89, 0x80 | len(content)]) + bytes(4) + content


class Full(asyncio.Transport):
    """Writes what it is given nowhere, and never has room for it, so that closing does not end."""

    def __init__(self) -> None:
        super().__init__()
        self.written = bytearray()
        self.aborted = asyncio.Event()

    def write(self, data: Any) -> None:
        self.written += data

    def is_closing(self) -> bool:
        return False

    def close(self) -> None: ...

    def abort(self) -> None:
        self.aborted.set()

    def pause_reading(self) -> None: ...

    def resume_reading(self) -> None: ...


async def accepting(_: Any, receive: Any, send: Any) -> None:
    """Accepts a connection and waits for what comes."""
    await receive()
    await send({"type": "websocket.accept"})
    await receive()


async def opened() -> tuple[WebSockets, Full]:
    """A connection after its handshake."""
    config = uvicorn.Config(accepting, log_config=None, **OPTIONS)
    config.load()
    made, transport = WebSockets(config, ServerState(), {}), Full()
    made.connection_made(transport)
    made.data_received(HANDSHAKE)
    while not made.handshake_complete:
        await asyncio.sleep(0)
    transport.written.clear()
    return made, transport


async def _pings() -> None:
    made, transport = await opened()
    made.data_received(ping(b"now"))
    assert bytes(transport.written) == b"\x8a\x03now"
    made.pause_writing()
    for number in range(100):
        made.data_received(ping(b"%02d" % number))
    assert bytes(transport.written) == b"\x8a\x03now"
    made.resume_writing()
    assert bytes(transport.written) == b"\x8a\x03now\x8a\x0299"
    made.pause_writing()
    made.resume_writing()
    assert len(transport.written) == 5 + 4


def test_of_pings_of_a_client_that_does_not_read_the_last_is_answered() -> None:
    asyncio.run(_pings())


async def _unanswered() -> None:
    made, transport = await opened()
    made.pause_writing()
    made.send_keepalive_ping()
    made.keepalive_timeout()
    await asyncio.wait_for(transport.aborted.wait(), 10)
    assert b"keepalive ping timeout" in transport.written


def test_who_answers_no_ping_and_reads_nothing_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_sockets, "LEFT_TO_READ", 0.01)
    asyncio.run(_unanswered())
