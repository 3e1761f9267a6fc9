"""The HTTP server: a socket that listens, and the application on it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

import uvicorn

from rhytid.errors import InputError
from rhytid.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine

LOOPBACK = "127.0.0.1"
# Seconds that open requests get to finish; a stream of events would never end by itself.
GRACE = 5


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; port 0 is a free one. Raises InputError naming the address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family)
    except OSError as exc:
        # Python adds the address to the system's own words, which are enough.
        reason = str(exc.strerror).partition(" (while")[0]
        raise InputError(f"cannot listen on {host} port {port}: {reason}") from exc
    # Connections inherit it. Without, the end of an answer waits for the client to acknowledge its
    # beginning, which clients put off for 40 ms.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening


def address_of(listening: socket.socket) -> str:
    """The URL of a listening socket."""
    host, port = listening.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def server_of(engine: Engine, settings: ServiceSettings, log_level: str) -> uvicorn.Server:
    """The application over an engine, ready to run on sockets."""
    from rhytid.api.app import create_app

    app = create_app(engine, settings)
    return uvicorn.Server(
        uvicorn.Config(app, log_level=log_level, ws="none", timeout_graceful_shutdown=GRACE)
    )


@contextmanager
def serving(settings: ServiceSettings) -> Iterator[str]:
    """The URL of a real server on a free loopback port.

    It runs in a thread of this process, so it ends with the block, and with the process at last.
    """
    from rhytid.engine.engine import Engine

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
