"""Parts of uvicorn, h11 and websockets that are not public, and that our classes rely on."""

from __future__ import annotations

import inspect
import re
from importlib.metadata import version

import h11._connection
import pytest
import uvicorn
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from rhytid.api.server.connections import LimitedConnection
from rhytid.api.server.http_server import DrainingServer
from rhytid.api.server.web_sockets import WebSockets

# The newest releases that the classes in rhytid/api/server were compared with.
COMPARED = {"uvicorn": (0, 54), "h11": (0, 16), "websockets": (17, 4)}
OVERRIDDEN = {
    LimitedConnection: {
        "connection_made": ["transport"],
        "data_received": ["data"],
        "connection_lost": ["exc"],
        "handle_websocket_upgrade": ["event"],
        "send_400_response": ["msg"],
    },
    WebSockets: {
        "data_received": ["data"],
        "shutdown": [],
        "connection_lost": ["exc"],
        "send": ["message"],
        "handle_ping": [],
        "resume_writing": [],
        "keepalive_timeout": [],
        "run_asgi": [],
    },
    DrainingServer: {
        "handle_exit": ["sig", "frame"],
        "on_tick": ["counter"],
        "shutdown": ["sockets"],
    },
}
# Attributes that our classes read or set; the classes of uvicorn make them.
READ = {
    H11Protocol: ["connections", "client", "transport", "flow", "cycle", "headers", "loop"],
    RequestResponseCycle: [
        "response_started", "response_complete", "more_body", "disconnected", "message_event",
        "scope",
    ],
    FlowControl: ["read_paused", "write_paused"],
    WebSocketsSansIOProtocol: [
        "conn", "logger", "client", "transport", "loop", "handshake_initiated",
        "handshake_complete", "initial_response", "close_sent", "writable",
    ],
    uvicorn.Server: ["config", "force_exit", "lifespan", "should_exit"],
}  # fmt: skip


@pytest.mark.parametrize("package", COMPARED)
def test_no_newer_release_is_installed_than_was_compared(package: str) -> None:
    installed = tuple(int(part) for part in version(package).split(".")[:2])

    assert installed <= COMPARED[package], (
        f"{package} {version(package)} is newer than the release that rhytid/api/server was "
        "compared with: read what changed in the parts below, then raise COMPARED"
    )


@pytest.mark.parametrize(
    ("ours", "name"), [(ours, name) for ours, names in OVERRIDDEN.items() for name in names]
)
def test_what_is_overridden_is_called_as_before(ours: type, name: str) -> None:
    [base] = [one for one in ours.__mro__[1:] if one.__module__.startswith("uvicorn.")][:1]
    parameters = list(inspect.signature(getattr(base, name)).parameters)

    assert parameters == ["self", *OVERRIDDEN[ours][name]]
    assert list(inspect.signature(getattr(ours, name)).parameters) == parameters


@pytest.mark.parametrize(
    ("base", "name"), [(b, name) for b, names in READ.items() for name in names]
)
def test_what_is_read_is_there(base: type, name: str) -> None:
    assert re.search(rf"self\.{name}\b", inspect.getsource(base))


def test_the_limit_of_a_head_is_there() -> None:
    assert h11._connection.DEFAULT_MAX_INCOMPLETE_EVENT_SIZE >= 1 << 14
