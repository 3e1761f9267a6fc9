"""HTTP connections with limits: how many there may be, and how long one may make no progress.

uvicorn closes a connection only where it is idle after an answer. Without these limits heads and
bodies may take forever, and a connection that is to be closed stays until its client has read all
of the answer.
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import logging
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from h11._connection import DEFAULT_MAX_INCOMPLETE_EVENT_SIZE
from uvicorn.protocols.http.h11_impl import H11Protocol

from rhytid.api.problems import MEDIA_TYPE
from rhytid.api.request_memory import PIECES
from rhytid.support.settings import ServiceSettings

logger = logging.getLogger(__name__)
# Bytes of a body that must come within the time for progress, or its end; bytes of an answer that
# must be taken within it.
PROGRESS, TAKEN = 1 << 14, 1 << 18
# Looks at a connection within that time.
_LOOKS = 4
# Headers of a request that has a body.
_BODY = frozenset((b"content-length", b"transfer-encoding"))


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits of connections.

    stalled: seconds for a head, for each PROGRESS bytes of a body, for each TAKEN bytes of an
    answer, and for the handshake of a WebSocket.  most: connections that may be open at once; one
    address may have half of them.  proxies: networks whose addresses may have all, since many
    callers come from them.
    """

    stalled: float
    most: int
    proxies: tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...] = ()

    @classmethod
    def of(cls, settings: ServiceSettings) -> ConnectionLimits:
        """The limits that the settings give."""
        proxies = tuple(ipaddress.ip_network(proxy) for proxy in settings.proxies)
        return cls(settings.stall_seconds, settings.connections, proxies)

    @property
    def most_of_one(self) -> int:
        """Connections that one address may have."""
        return max(self.most // 2, 1)

    def of_proxy(self, host: str | None) -> bool:
        """Whether an address is in `proxies`."""
        if host is None or not self.proxies:
            return False
        address = ipaddress.ip_address(host.partition("%")[0])
        return any(address in network for network in self.proxies)


def protocol_of(limits: ConnectionLimits) -> type[asyncio.Protocol]:
    """The class of connections with these limits, for the option `http` of uvicorn."""
    return type("Connection", (LimitedConnection,), {"limits": limits})


# Over h11 also where httptools is installed, which reads heads of any length.
class LimitedConnection(H11Protocol):
    """A connection that is closed where it is one too many or makes no progress. The client gets a
    problem where it can still be read."""

    limits: ConnectionLimits

    def connection_made(self, transport: Any) -> None:
        """Watch the connection, or refuse it."""
        super().connection_made(transport)
        self._received = 0
        self._seen: tuple[str | None, Any, int] = (None, None, 0)
        self._since = self.loop.time()
        self._look = self.loop.call_later(self.limits.stalled / _LOOKS, self._watch)
        if too_many := self._too_many():
            self._end(HTTPStatus.SERVICE_UNAVAILABLE, too_many)

    def data_received(self, data: bytes) -> None:
        """Count and read data. Data that comes after the end is dropped."""
        if not self.transport.is_closing():
            self._received += len(data)
            super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop watching the connection."""
        self._look.cancel()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand the connection over to `WebSockets`, which has limits of its own. Refuse an upgrade
        with a body, since no body is read before a handshake."""
        if body := _BODY & {name for name, _ in self.headers}:
            named = " and ".join(sorted(name.decode().title() for name in body))
            self._end(HTTPStatus.BAD_REQUEST, f"an upgrade to WebSocket has no body: {named}")
            return
        self._look.cancel()
        super().handle_websocket_upgrade(event)
        opened: Any = self.transport.get_protocol()  # `WebSockets`, by now
        opened.end_unless_open(self.limits.stalled)

    def send_400_response(self, msg: str) -> None:
        """Answer with a problem in place of plain text."""
        rule = f"or its head is above {DEFAULT_MAX_INCOMPLETE_EVENT_SIZE} bytes"
        self._end(HTTPStatus.BAD_REQUEST, f"the request is not valid HTTP, {rule}")

    def _too_many(self) -> str | None:
        """Why this connection, which is open already, is one too many; None where it is not."""
        most, most_of_one = self.limits.most, self.limits.most_of_one
        if len(self.connections) > most:
            return f"{most} connections are open already: RHYTID_CONNECTIONS allows no more"
        host = self._host(self)
        if self.limits.of_proxy(host):
            return None
        if sum(self._host(other) == host for other in self.connections) > most_of_one:
            rule = "half of what RHYTID_CONNECTIONS allows"
            return f"{most_of_one} connections from this address are open already: {rule}"
        return None

    @staticmethod
    def _host(connection: Any) -> str | None:
        client = getattr(connection, "client", None)
        return client[0] if client else None

    def _watch(self) -> None:
        """End the connection where it has made no progress for too long, else look again later."""
        now, seen = self.loop.time(), self._progress()
        if seen != self._seen or seen[0] is None:
            self._seen, self._since = seen, now
        elif now - self._since >= self.limits.stalled:
            self._stalled(seen[0])
        self._look = self.loop.call_later(self.limits.stalled / _LOOKS, self._watch)

    def _progress(self) -> tuple[str | None, Any, int]:
        """What the client has to do next, None for nothing; and a state that changes when it
        does."""
        if self.transport.is_closing():
            return "end", None, 0
        if self.cycle is None or self.cycle.response_complete:
            return "head", self.cycle, 0
        if self.cycle.response_started and self.flow.write_paused:
            left = self.transport.get_write_buffer_size() // TAKEN
            return "answer", (self.cycle, self.cycle.scope.get(PIECES, 0)), left
        # While the server does not read, it is not the client that makes no progress.
        if self.cycle.more_body and not self.flow.read_paused:
            return "body", self.cycle, self._received // PROGRESS
        return None, None, 0

    def _stalled(self, waited_for: str) -> None:
        if waited_for == "end":  # and its client does not read the rest
            self.transport.abort()
        elif waited_for == "answer":
            path = self.cycle.scope["path"].encode("unicode_escape").decode("ascii")
            logger.warning("%s: the client took nothing for %g seconds", path, self.limits.stalled)
            self.transport.abort()
        elif waited_for == "body" and not self.cycle.response_started:
            rule = f"{PROGRESS} bytes or its end must come within {self.limits.stalled:g} seconds"
            self._end(HTTPStatus.REQUEST_TIMEOUT, f"the body made no progress: {rule}")
        elif waited_for == "head" and self._received and self.cycle is None:
            rule = f"it must come within {self.limits.stalled:g} seconds"
            self._end(HTTPStatus.REQUEST_TIMEOUT, f"the head of the request is not whole: {rule}")
        else:
            self.transport.close()

    def _end(self, status: HTTPStatus, detail: str) -> None:
        """Close the connection with a problem."""
        logger.warning("%s: %s", self._host(self), detail)
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        self.transport.write(bare_problem(status, detail))
        self.transport.close()


def bare_problem(status: HTTPStatus, detail: str) -> bytes:
    """The bytes of an answer with a problem, without the application."""
    about = {"type": "about:blank", "title": status.phrase, "status": status, "detail": detail}
    body = json.dumps(about).encode()
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {MEDIA_TYPE}\r\n"
        f"Content-Length: {len(body)}\r\nRetry-After: 5\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + body
