"""How a live connection ends that something else has ended already, or that cannot begin."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from starlette.websockets import WebSocketDisconnect

from api.patch import smile
from live.gated import TILE, GatedEngine
from live.speaker import Speaker
from rhytid.api.live.session import LiveSession
from rhytid.errors import CancelledError, DeviceLostError


class Closed:
    """A connection that the server's protocol has closed by itself."""

    async def send(self, _: Any) -> None:
        raise RuntimeError("Unexpected ASGI message 'websocket.send'")


def test_a_tile_for_a_connection_that_is_closed_is_no_failure_of_the_server() -> None:
    closed: Any = Closed()
    unused: Any = None
    session = LiveSession(closed, unused, {}, 25, 1, unused)
    with pytest.raises(WebSocketDisconnect) as raised:
        asyncio.run(session._send({"type": "websocket.send", "bytes": b"tile"}))
    assert raised.value.code == 1006


def test_a_cancelled_frame_is_told_while_the_client_is_there(
    engine: GatedEngine, speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    speaker.open(tiles=[TILE])
    monkeypatch.setattr(engine, "error", CancelledError("asset a was removed"))
    speaker.positions(1, smile())
    _, end = speaker.answer()
    assert (end["status"], end["detail"]) == (409, "asset a was removed")


def test_a_device_that_restarts_while_a_connection_begins_asks_to_come_again(
    engine: GatedEngine, speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(_: str) -> Any:
        raise DeviceLostError("it is restarted")

    monkeypatch.setattr(engine.assets, "shapes", lost)
    speaker.tell("open", tiles=[TILE])
    assert speaker.closed() == (1013, "it is restarted")
