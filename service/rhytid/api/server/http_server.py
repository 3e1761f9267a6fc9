"""The HTTP server: a listening socket, and the application on it."""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from ipaddress import ip_address
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import uvicorn

from rhytid.api.keys import check_mark, has_valid_key
from rhytid.api.server.web_sockets import OPTIONS
from rhytid.errors import AccessError, InputError
from rhytid.support.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.api.draining import Drain
    from rhytid.engine.operations import Engine

LOOPBACK = "127.0.0.1"
# Seconds that open requests get to finish after an interrupt.
GRACE = 5
# The same once these had the time of a drain, or somebody does not want to wait for it.
LAST_GRACE = 1


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


def asks_keys(
    listening: socket.socket,
    keys: Path,
    *,
    without: bool,
    mark: Path | None = None,
    named: bool = False,
) -> bool | None:
    """The value of the setting `ask_keys` for a server on this socket.

    keys: file of the keys.  without: whether nobody is asked for a key.  mark: file that says that
    keys were asked for before.  named: whether the user named the file of the keys. Raises
    AccessError where the file should exist and does not, and where other machines reach the socket
    but no key is valid; StorageError where the file cannot be read.
    """
    if without:
        return False
    valid = has_valid_key(keys)
    if mark is not None:
        check_mark(keys, mark)
    if named and not keys.exists():
        raise AccessError(
            f"RHYTID_KEYS_FILE names {keys}, which is not there: is it mounted? Make a key with "
            "`rhytid keys create NAME`, or give --without-keys"
        )
    if ip_address(listening.getsockname()[0]).is_loopback:
        return None
    if not valid:
        raise AccessError(
            f"{address_of(listening)} can be reached from other machines, and {keys} has no valid "
            "API key: make one with `rhytid keys create NAME`, listen on 127.0.0.1, or give "
            "--without-keys where a proxy in front of the server knows who may use it"
        )
    return True


def engine_of(settings: ServiceSettings, *, in_process: bool) -> Engine:
    """An engine in a process of its own; in this one where `in_process` says so, and on Windows.
    Raises what `Engine` does."""
    from rhytid.processes.device_process import possible

    if in_process or not possible():
        from rhytid.engine.engine import Engine

        return Engine(settings)
    from rhytid.processes.remote_engine import RemoteEngine

    return RemoteEngine(settings)


class DrainingServer(uvicorn.Server):
    """A server that drains when SIGTERM comes: it finishes requests that it has, and answers new
    ones with 503.

    begun: called when draining begins.
    """

    def __init__(self, config: uvicorn.Config, drain: Drain, begun: Callable[[], None]) -> None:
        super().__init__(config)
        self._drain, self._begun = drain, begun
        self._signal: int | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to drain. A second signal, or another than SIGTERM, ends the server at once."""
        if self._drain.begun:
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
        if self._signal is not None and self._drain.over and not self.should_exit:
            self._end(self._signal)
        return await super().on_tick(counter)

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
