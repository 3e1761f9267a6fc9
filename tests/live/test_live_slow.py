"""A live client that does not read, with little room on its side."""

from __future__ import annotations

import gc
import json
import os
import socket
import struct
import time
from base64 import b64encode
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from api.asking import built
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from rhytid.api.live import session

TILES = [[1001, 0, row, column] for row in range(4) for column in range(4)]


def shaken_hands(client: httpx.Client, asset: str) -> socket.socket:
    """A socket after the handshake, which takes few bytes that nobody reads."""
    host, port = client.base_url.host, client.base_url.port
    found = socket.socket()
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    found.connect((host, port))
    key = b64encode(os.urandom(16)).decode()
    found.sendall(
        f"GET /v1/assets/{asset}/live HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n"
        "Sec-WebSocket-Protocol: rhytid.live.1\r\n\r\n".encode()
    )
    assert b" 101 " in found.recv(1024)
    return found


def message(opcode: int, content: bytes) -> bytes:
    """A message as clients send it, masked with zeros."""
    head = struct.pack(">BBH", 0x80 | opcode, 0x80 | 126, len(content))
    return head + bytes(4) + content


def frame(number: int) -> bytes:
    return struct.pack("<QII", number, 1, 25) + smile(0.001 * number).astype("<f4").tobytes()


def ends(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What the log says of connections that ended."""
    return [record.message for record in caplog.records if record.name == session.__name__]


def test_what_nobody_reads_is_not_drawn_and_not_kept(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(session, "STALLED", 0.3)
    monkeypatch.setattr("rhytid.api.server.web_sockets.LEFT_TO_READ", 0.1)
    caplog.set_level("INFO", "rhytid.api.live.session")
    engine = FakeEngine()
    with serving(engine) as client:
        asset = built(client, upload())
        gc.collect()  # descriptors of tests before, which may go at any time
        open_before = len(list(Path("/proc/self/fd").iterdir()))
        with shaken_hands(client, asset) as slow:
            header = {"message": "open", "tiles": TILES}
            slow.sendall(message(1, json.dumps(header).encode()))
            deadline = time.monotonic() + 20
            number = 0
            with suppress(OSError):  # the connection may end between two
                while not ends(caplog) and time.monotonic() < deadline:
                    slow.sendall(message(2, frame(number := number + 1)))
                    time.sleep(0.005)
            assert "closed with 1006" in ends(caplog)[-1]
            # Buffers of the system take some frames; then the newest waits alone.
            assert len(engine.drawn) * 4 * 64 * 64 < 16 << 20
            assert engine.memory.used == 0
            # Though nothing was read, the server has nothing of it left but our end.
            time.sleep(0.3)
            assert len(list(Path("/proc/self/fd").iterdir())) <= open_before + 1
        assert client.get("/healthz").status_code == 200
