"""The application under a real server on a free loopback port, with a client."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import httpx
import uvicorn

from rhytid.api.app import create_app
from rhytid.api.server.http_server import protocol_options
from rhytid.support.settings import ServiceSettings


class _Server(uvicorn.Server):
    """Tells when it listens, and on which port."""

    def __init__(self, app: Any, settings: ServiceSettings) -> None:
        config = uvicorn.Config(
            app,
            port=0,
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=1,
            **protocol_options(settings),
        )
        super().__init__(config)
        self.listening = threading.Event()

    async def startup(self, *args: Any, **options: Any) -> None:
        await super().startup(*args, **options)
        self.listening.set()

    @property
    def url(self) -> str:
        host, port = self.servers[0].sockets[0].getsockname()
        return f"http://{host}:{port}"


class _Client(httpx.Client):
    """A client of a running server, which it can end."""

    def __init__(self, server: _Server) -> None:
        super().__init__(base_url=server.url, timeout=60)
        self._server = server

    def stop(self) -> None:
        self._server.should_exit = True


@contextmanager
def serving(engine: Any, **settings: Any) -> Iterator[_Client]:
    """A client of a running server; the server ends with the block."""
    chosen = ServiceSettings(**settings)
    server = _Server(create_app(engine, chosen), chosen)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        assert server.listening.wait(30)
        with closing(_Client(server)) as client:
            yield client
    finally:
        server.should_exit = True
        thread.join(30)
        if thread.is_alive():
            waits = [*server.server_state.tasks, *server.server_state.connections]
            server.force_exit = True
            thread.join()
            raise AssertionError(f"the server waited for {waits}")
