"""`rhytid serve`: the HTTP service."""

from __future__ import annotations

import argparse
import socket
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

from rhytid import __version__
from rhytid.cli.options import Commands, add_device, new_command, port_number
from rhytid.cli.progress import voice
from rhytid.cli.termination import Terminated
from rhytid.settings import ServiceSettings

PORT = 8717


def add_command(commands: Commands) -> None:
    """Add `serve` to the parser."""
    parser = new_command(
        commands,
        "serve",
        "Serve displacement tiles over HTTP until interrupted.",
        f"rhytid serve --port {PORT} --store assets",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    port = "port; 0 takes a free one and prints it"
    parser.add_argument("--port", type=port_number, default=PORT, metavar="PORT", help=port)
    store = "folder of the assets (default: of RHYTID_STORE, else rhytid-store)"
    parser.add_argument("--store", type=Path, metavar="DIR", help=store)
    without = "ask for no API keys: for a server behind a proxy that knows who may use it"
    parser.add_argument("--without-keys", action="store_true", help=without)
    add_device(parser)
    inside = (
        "compute in the process of the server; otherwise the device has one, which is restarted"
    )
    parser.add_argument("--in-process", action="store_true", help=inside)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Listen, print the address, and serve."""
    # Imported here, so that --help does not wait for OpenCL and the web framework.
    from rhytid.cli.server import asks_keys, listen

    settings = _with_places(chosen(arguments.store, arguments.device))
    listening = listen(arguments.host, arguments.port)
    with closing(listening):
        ask = asks_keys(listening, settings.key_file, without=arguments.without_keys)
        _serve(listening, replace(settings, ask_keys=ask), in_process=arguments.in_process)


def _serve(listening: socket.socket, settings: ServiceSettings, *, in_process: bool) -> None:
    from rhytid.cli.connections import allow_files
    from rhytid.cli.server import address_of, engine_of, server_of

    allow_files(settings.connections)
    with closing(engine_of(settings, in_process=in_process)) as engine:
        device = next(d for d in engine.devices() if d.selected)
        where = f"{device.name} ({device.platform}), store {settings.store}"
        print(f"rhytid {__version__} on {address_of(listening)}, {where}", flush=True)
        with suppress(Terminated):  # SIGTERM ends a server
            server_of(engine, settings, _log_level()).run(sockets=[listening])


def _with_places(settings: ServiceSettings) -> ServiceSettings:
    """The settings; where nothing but the store can be written, what is kept goes there."""
    from rhytid.device.caches import provide_places, writable

    place = provide_places(settings.store / "cache")
    if place is None or (settings.cache is not None and writable(settings.cache)):
        return settings
    return replace(settings, cache=place / "rhytid")


def _log_level() -> str:
    if voice().verbose:
        return "debug"
    return "warning" if voice().quiet else "info"


def chosen(store: Path | None, device: str | None) -> ServiceSettings:
    """The settings of the environment, which the command line overrides."""
    found = ServiceSettings.from_environment()
    return replace(found, store=store or found.store, device=device or found.device)
