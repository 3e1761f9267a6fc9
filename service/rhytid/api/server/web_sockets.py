"""WebSocket connections with limits."""

from __future__ import annotations

import asyncio
import logging
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from rhytid.api.server.connections import bare_problem

# Bytes of one message: positions of 1.4 million vertices.
LARGEST = 16 << 20
# Seconds between two pings, and for the answer to one.
PING = 20.0
# Seconds in which a client may read what was sent before the connection ended.
LEFT_TO_READ = 10.0
# For failures alone: at INFO uvicorn writes addresses with their query, in which a key may be. The
# application logs each handshake by its path.
logger = logging.getLogger(__name__)
logger.setLevel(logging.WARNING)


class WebSockets(WebSocketsSansIOProtocol):
    """A WebSocket whose handshake has a time limit, and which keeps little of what the client does
    not read. Heads and queries of handshakes, which hold keys, stay out of the log."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.conn.debug = False
        self.logger = logger
        # The answer to the last pings, while there is no room for it.
        self._pong: list[bytes] = []
        self._handshake: asyncio.TimerHandle | None = None

    def end_unless_open(self, seconds: float) -> None:
        """End the connection where, within so many seconds, the application has not accepted it, or
        the client has not read its refusal."""
        self._handshake = self.loop.call_later(seconds, self._not_open, seconds)

    def _not_open(self, seconds: float) -> None:
        if self.transport.is_closing():  # and its client does not read the rest
            self.transport.abort()
        elif not self.handshake_complete:
            rule = f"it must be accepted within {seconds:g} seconds"
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, f"the handshake took too long: {rule}")

    def _refuse(self, status: HTTPStatus, detail: str) -> None:
        """Answer in place of the application, and end the connection."""
        logger.warning("%s: %s", self.client[0] if self.client else None, detail)
        self.transport.write(bare_problem(status, detail))
        self.transport.close()
        self.loop.call_later(LEFT_TO_READ, self.transport.abort)

    def data_received(self, data: bytes) -> None:
        """Read data. The first data is the whole head of the handshake: if it holds no request,
        none will follow."""
        super().data_received(data)
        if not self.handshake_initiated and not self.transport.is_closing():
            rule = "its head is too long, or not that of a handshake"
            self._refuse(HTTPStatus.BAD_REQUEST, f"the upgrade to WebSocket was not read: {rule}")

    def shutdown(self) -> None:
        """End the connection when the server ends. Before a handshake it cannot carry a reason."""
        if self.handshake_initiated:
            super().shutdown()
        else:
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the time limit of the handshake."""
        if self._handshake is not None:
            self._handshake.cancel()
        super().connection_lost(exc)

    async def send(self, message: Any) -> None:
        """Send a message of the application.

        A message that accepts a connection may have `largest`: the most bytes of a message from the
        client, at most LARGEST. Larger messages end the connection.
        """
        if "largest" in message:
            largest = min(LARGEST, message["largest"])
            # As version 17 of websockets calls it, and as earlier ones do.
            for name in ("max_message_size", "max_size"):
                setattr(self.conn, name, largest)
        await super().send(message)
        # Else an answer in place of a connection is logged as an error of the application.
        self.handshake_complete |= self.initial_response is not None and self.close_sent

    def handle_ping(self) -> None:
        """Answer a ping. While the client does not read, only the last answer is kept: frames are
        still read, and memory must not grow."""
        if self.writable.is_set():
            super().handle_ping()
        else:
            # All pings of one read are answered at the first of them.
            self._pong = self.conn.data_to_send() or self._pong

    def resume_writing(self) -> None:
        """Send the answer that was kept, now that there is room."""
        super().resume_writing()
        pong, self._pong = self._pong, []
        if pong and not self.close_sent:
            self.transport.write(b"".join(pong))

    def keepalive_timeout(self) -> None:
        """End a connection whose client answers no ping, and close it for good if it reads
        nothing."""
        super().keepalive_timeout()
        self.loop.call_later(LEFT_TO_READ, self.transport.abort)

    async def run_asgi(self) -> None:
        """Run the application; close the connection for good a while after it has ended."""
        try:
            await super().run_asgi()
        finally:
            self.loop.call_later(LEFT_TO_READ, self.transport.abort)


# Options of uvicorn. No compression: it costs more time than it saves on a network that carries
# frames, and a small message could become a large one.
OPTIONS: dict[str, Any] = {
    "ws": WebSockets,
    "ws_max_size": LARGEST,
    "ws_ping_interval": PING,
    "ws_ping_timeout": PING,
    "ws_per_message_deflate": False,
}
