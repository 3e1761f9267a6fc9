"""`rhytid serve`: the HTTP service."""

from __future__ import annotations

import argparse
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from rhytid import __version__
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import (
    add_device,
    add_shared_store,
    add_store,
    port_number,
    service_settings,
)
from rhytid.cli.summaries import SUMMARIES
from rhytid.cli.termination import TERMINATED, Terminated, end_now
from rhytid.domain.wording import install_hint
from rhytid.errors import InputError
from rhytid.processes.interpreter import interpreter_ahead, possible
from rhytid.support.console import verbosity
from rhytid.support.garbage import tidy_at_rest
from rhytid.support.logs import log_to_stderr
from rhytid.support.settings import LOG_FORMATS, ServiceSettings, misspelt_variables

if TYPE_CHECKING:
    from rhytid.engine.operations import Engine

logger = logging.getLogger(__name__)
PORT = 8717
ALL = "all"
# In place of the address of a cluster of Ray: this machine alone.
LOCAL = "local"
# Seconds after a drain in which the process has to end.
LAST = 10.0


def add_command(commands: Commands) -> None:
    """Add `serve` to the parser."""
    parser = new_command(
        commands,
        "serve",
        SUMMARIES["serve"],
        f"rhytid serve --port {PORT} --store assets",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    port = "port; 0 takes a free one and prints it"
    parser.add_argument("--port", type=port_number, default=PORT, metavar="PORT", help=port)
    add_store(parser)
    add_shared_store(parser)
    without = "ask for no API keys: for a server behind a proxy that knows who may use it"
    parser.add_argument("--without-keys", action="store_true", help=without)
    add_device(parser)
    several = (
        "compute on several devices: `all` that compute, or their numbers with commas; each asset "
        "is on one of them (default: one device)"
    )
    parser.add_argument("--devices", type=device_numbers, metavar="LIST", help=several)
    inside = (
        "compute in the process of the server; otherwise the device has one, which is restarted"
    )
    parser.add_argument("--in-process", action="store_true", help=inside)
    _add_fleet(parser)
    form = "lines of the log on stderr (default: of RHYTID_LOG_FORMAT, else text)"
    parser.add_argument("--log-format", choices=LOG_FORMATS, help=form)
    parser.set_defaults(run=run)


def _add_fleet(parser: argparse.ArgumentParser) -> None:
    """Add `--ray` and `--replicas`."""
    ray = (
        "compute in replicas of Ray Serve, one a device, behind this server: of the cluster at "
        "ADDRESS, or of this machine alone where none is given (extra ray)"
    )
    parser.add_argument("--ray", nargs="?", const=LOCAL, metavar="ADDRESS", help=ray)
    replicas = "of --ray, how many there are: a number, or two such as 2-8 (default: 1)"
    parser.add_argument("--replicas", metavar="N", help=replicas)


def device_numbers(text: str) -> tuple[str, ...]:
    """Numbers with commas between them, or `all`."""
    numbers = tuple(text.split(","))
    if text != ALL and not all(number.isascii() and number.isdigit() for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r}: must be {ALL}, or numbers such as 0,2")
    return numbers


def run(arguments: argparse.Namespace) -> None:
    """Listen, print the address, and serve until interrupted."""
    from rhytid.api.server.listening import allow_files

    settings = _with_places(
        service_settings(arguments.store, arguments.device, arguments.shared_store)
    )
    settings = replace(
        settings,
        log_format=arguments.log_format or settings.log_format,
        devices=arguments.devices or (),
    )
    if settings.devices and (arguments.device or arguments.in_process):
        other = "--device" if arguments.device else "--in-process"
        raise InputError(f"--devices and {other} cannot be given together")
    if settings.store.is_file():
        raise InputError(f"the store {settings.store} is a file, not a folder")
    fleet = _fleet_of(arguments, settings)
    allow_files(settings.connections)  # of the process that is begun, too
    if fleet is not None:
        _listen(arguments, settings, fleet)
    elif arguments.in_process or not possible():
        _listen(arguments, settings, _engine_here)
    else:
        with interpreter_ahead():  # before anything that takes long is imported
            _listen(arguments, settings, _remote_engine)


def _listen(
    arguments: argparse.Namespace,
    settings: ServiceSettings,
    engine_of: Callable[[ServiceSettings], AbstractContextManager[Any]],
) -> None:
    # Imported here, so that --help does not wait for OpenCL and the web framework.
    from rhytid.api.server.listening import asks_keys, listen

    listening = listen(arguments.host, arguments.port)
    with closing(listening):
        ask = asks_keys(
            listening,
            settings.key_file,
            without=arguments.without_keys,
            mark=settings.key_mark,
            named=settings.keys is not None,
        )
        settings = replace(settings, ask_keys=ask)
        _serve(listening, settings, engine_of(settings))


def _fleet_of(
    arguments: argparse.Namespace, settings: ServiceSettings
) -> Callable[[ServiceSettings], AbstractContextManager[Any]] | None:
    """A function that makes the engine of a fleet from settings; None where `--ray` is not given.

    Raises InputError for options that do not go together and where the extra is missing,
    SettingsError for a wrong number of replicas.
    """
    if arguments.ray is None:
        if arguments.replicas is not None:
            raise InputError("--replicas is for --ray")
        return None
    if arguments.in_process:
        raise InputError("--ray and --in-process cannot be given together")
    # Beside the packages of the extra, Ray takes a while to import.
    from rhytid.fleet.options import FleetOptions

    options = FleetOptions.read({"store": settings.store, "replicas": arguments.replicas or "1"})
    try:
        from rhytid.fleet.app import local_fleet
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] == "rhytid":
            raise
        raise InputError(
            f"--ray needs the extra ray, and {error.name} is missing; {install_hint('ray')}"
        ) from error
    address = None if arguments.ray == LOCAL else arguments.ray
    return partial(local_fleet, options=options, address=address)


@contextmanager
def _engine_here(settings: ServiceSettings) -> Iterator[Engine]:
    """An engine in this process. Raises what `rhytid.engine.engine.Engine` does."""
    from rhytid.engine.engine import Engine as Here

    with closing(Here(settings)) as made:
        yield made


@contextmanager
def _remote_engine(settings: ServiceSettings) -> Iterator[Engine]:
    """An engine in a process of its own. Raises as `_engine_here`."""
    from rhytid.processes.remote_engine import RemoteEngine

    # No daemon: the interpreter must not end within it.
    importing = threading.Thread(target=_import_server, name="rhytid-imports")
    importing.start()
    made: Engine = RemoteEngine(settings)
    with closing(made):
        # A signal that ends an import of this thread may leave the other one waiting for good.
        importing.join()
        yield made


def _import_server() -> None:
    """Import the web framework while the engine starts, which waits for another process."""
    with suppress(Exception):  # `_serve` raises it
        import rhytid.api.app
        import rhytid.api.server.http_server  # noqa: F401


def _serve(
    listening: socket.socket, settings: ServiceSettings, engine_for: AbstractContextManager[Any]
) -> None:
    from rhytid.api.keys import leave_mark
    from rhytid.api.server.listening import address_of

    log_to_stderr(settings.log_format, logging.getLevelName(_log_level().upper()), "server")
    for line in misspelt_variables():
        logger.warning("%s", line)
    if settings.traces:
        from rhytid.api.tracing import send_spans

        send_spans()
    with engine_for as engine:
        from rhytid.api.server.http_server import server_of

        # The store is there by now, on this machine.
        asked = settings.ask_keys is not False and settings.key_file.exists()
        if asked and settings.store.is_dir():
            leave_mark(settings.key_mark)
        used = [f"{d.name} ({d.platform})" for d in engine.devices() if d.selected]
        where = f"{' and '.join(used)}, store {settings.store}"
        if settings.shared_store:
            where += f", shared store {settings.shared_store}"
        print(f"rhytid {__version__} on {address_of(listening)}, {where}", flush=True)
        with suppress(Terminated):  # SIGTERM ends a server
            by = settings.drain_seconds + LAST
            server = server_of(engine, settings, _log_level(), partial(_end_by, by))
            tidy_at_rest(threading.Event())
            server.run(sockets=[listening])


def _end_by(seconds: float) -> None:
    """End this process after so many seconds, whatever hangs in it."""
    last = threading.Timer(seconds, end_now, (TERMINATED,))
    last.daemon = True
    last.start()


def _with_places(settings: ServiceSettings) -> ServiceSettings:
    """The settings with a cache in the store, where no other place can be written."""
    from rhytid.device.caches import provide_places, writable

    place = provide_places(settings.store / "cache")
    if place is None or (settings.cache is not None and writable(settings.cache)):
        return settings
    return replace(settings, cache=place / "rhytid")


def _log_level() -> str:
    if verbosity().verbose:
        return "debug"
    return "warning" if verbosity().quiet else "info"
