"""The HTTP server: the application on a listening socket."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from types import FrameType
from typing import TYPE_CHECKING, Any

import uvicorn

from rhytid.api.server.listening import LOOPBACK, address_of, listen
from rhytid.api.server.web_sockets import OPTIONS
from rhytid.support.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.api.draining import Drain
    from rhytid.engine.operations import Engine

_log, _uvicorn = logging.getLogger(__name__), logging.getLogger("uvicorn.error")
# Seconds that open requests get to finish after an interrupt.
GRACE = 5
# The same once these had the time of a drain, or somebody does not want to wait for it.
LAST_GRACE = 1
# Seconds in which requests that are cancelled then are answered.
_LAST_WORDS = 0.1


def _is_needed(record: logging.LogRecord) -> bool:
    """Not where uvicorn takes an answer that was broken off for a fault of the application:
    `Draining` has told of it."""
    return record.msg != "ASGI callable returned without completing response."


class DrainingServer(uvicorn.Server):
    """A server that drains when SIGTERM comes: it finishes requests that it has, and answers new
    ones with 503.

    begun: called when draining begins.
    """

    def __init__(self, config: uvicorn.Config, drain: Drain, begun: Callable[[], None]) -> None:
        super().__init__(config)
        self._drain, self._begun = drain, begun
        self._signal: int | None = None
        self._told = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to drain. A second signal after SIGTERM, or another one, ends the server as soon as
        open requests had their last grace."""
        if self._signal is not None:
            self._end(sig)
            return
        if sig != signal.SIGTERM:
            super().handle_exit(sig, frame)
            return
        self._signal = sig
        self._drain.begin()
        self._begun()

    async def on_tick(self, counter: int) -> bool:
        """Whether to end; uvicorn asks ten times a second."""
        if self._signal is not None and not self._told:
            self._told = True
            _log.info("SIGTERM: new requests are refused, %d finish", self._drain.running)
        if self._signal is not None and self._drain.over and not self.should_exit:
            self._end(self._signal)
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Drain for as long as uvicorn waits, after SIGINT, too. End the lifespan of the
        application even after a second SIGINT, at which uvicorn leaves it to be cancelled, and logs
        that as an error. Break off what is left then: uvicorn lets a connection be whose client
        does not read the rest, and uvloop fails to close around it."""
        self._drain.begin()
        _uvicorn.addFilter(_is_needed)
        try:
            await super().shutdown(sockets)
            if self.force_exit:
                await self.lifespan.shutdown()
            if self.server_state.connections:
                await asyncio.sleep(_LAST_WORDS)
            for connection in list(self.server_state.connections):
                connection.transport.abort()
        finally:
            _uvicorn.removeFilter(_is_needed)

    def _end(self, sig: int) -> None:
        """End the server; requests get LAST_GRACE seconds."""
        self.config.timeout_graceful_shutdown = LAST_GRACE
        super().handle_exit(sig, None)


def server_of(
    engine: Engine,
    settings: ServiceSettings,
    log_level: str,
    draining: Callable[[], None] = lambda: None,
) -> uvicorn.Server:
    """A server of an engine, ready to run on sockets. The caller sets up logging.

    draining: called when the server begins to drain.
    """
    from rhytid.api.app import create_app

    app = create_app(engine, settings)
    # Each request is logged by the application, with its id.
    config = uvicorn.Config(
        app, log_level=log_level, log_config=None, access_log=False,
        timeout_graceful_shutdown=GRACE, **protocol_options(settings),
    )  # fmt: skip
    return DrainingServer(config, app.state.drain, draining)


def protocol_options(settings: ServiceSettings) -> dict[str, Any]:
    """Options of uvicorn for HTTP and WebSocket, and for proxies whose headers it believes. By
    default uvicorn would believe every program of this machine, and FORWARDED_ALLOW_IPS."""
    from rhytid.api.server.connections import ConnectionLimits, protocol_of

    return {
        "http": protocol_of(ConnectionLimits.of(settings)),
        "proxy_headers": bool(settings.proxies),
        "forwarded_allow_ips": list(settings.proxies),
        **OPTIONS,
    }


@contextmanager
def serving(settings: ServiceSettings) -> Iterator[str]:
    """The URL of a server on a free loopback port, in a thread of this process. It ends with the
    block, and asks for no API keys."""
    from rhytid.engine.engine import Engine

    settings = replace(settings, ask_keys=False)
    with closing(listen(LOOPBACK, 0)) as listening, closing(Engine(settings)) as engine:
        server = server_of(engine, settings, "warning")
        options = {"sockets": [listening]}
        thread = threading.Thread(target=server.run, kwargs=options, name="rhytid-server")
        thread.start()
        try:
            yield address_of(listening)
        finally:
            server.should_exit = True
            thread.join()
