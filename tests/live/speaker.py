"""A WebSocket of a test, spoken by the words of docs/live.md alone: nothing of ours is used."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

DTYPES = {1: "<f4", 2: "<f2", 3: "<u2"}


@dataclass
class Tile:
    """A binary message, taken apart."""

    frame: int
    address: tuple[int, int, int, int]
    codes: int
    dropped: int
    scale: float
    values: NDArray[Any]


class Speaker:
    """Sends and receives messages of a live connection."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.ready: dict[str, Any] = {}

    def open(self, **header: Any) -> dict[str, Any]:
        self.tell("open", **header)
        self.ready = self.text()
        assert self.ready["message"] == "ready"
        return self.ready

    def tell(self, message: str, **facts: Any) -> None:
        self.socket.send(json.dumps({"message": message, **facts}))

    def positions(self, number: int, positions: Any) -> None:
        values = np.asarray(positions, "<f4")
        self.socket.send(struct.pack("<QII", number, 1, len(values)) + values.tobytes())

    def weights(self, number: int, weights: Any) -> None:
        values = np.asarray(weights, "<f4")
        self.socket.send(struct.pack("<QII", number, 2, len(values)) + values.tobytes())

    def text(self) -> dict[str, Any]:
        found = json.loads(self.socket.recv(10))
        assert isinstance(found, dict)
        return found

    def answer(self) -> tuple[list[Tile], dict[str, Any]]:
        """Tiles up to the text that ends a frame, and that."""
        tiles = []
        while isinstance(message := self.socket.recv(10), bytes):
            tiles.append(tile_of(message))
        found = json.loads(message)
        assert found["message"] in ("frame", "problem")
        return tiles, found

    def closed(self) -> tuple[int, str]:
        """Code and reason of the close that comes after whatever else comes."""
        with pytest.raises(ConnectionClosed) as raised:
            self._all()
        end = raised.value.rcvd
        return (1006, "") if end is None else (end.code, end.reason)

    def _all(self) -> None:
        while True:
            self.socket.recv(10)


def tile_of(message: bytes) -> Tile:
    number, udim, level, row, column, side, codes, zero, dropped, scale = struct.unpack_from(
        "<QIIIIIHHIf", message
    )
    assert zero == 0
    values = np.frombuffer(message, DTYPES[codes], offset=40).reshape(side, side)
    return Tile(number, (udim, level, row, column), codes, dropped, scale, values)


@contextmanager
def speaking(
    client: httpx.Client, asset: str, query: str = "", **options: Any
) -> Iterator[Speaker]:
    """A connection to an asset of a server; its first message is not sent yet."""
    options = {"subprotocols": ["rhytid.live.1"], "compression": None, "max_size": None, **options}
    url = str(client.base_url).replace("http", "ws", 1)
    with connect(f"{url}/v1/assets/{asset}/live{query}", proxy=None, **options) as socket:
        yield Speaker(socket)
