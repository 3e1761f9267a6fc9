"""A fleet for `rhytid serve --ray`: the server is the ingress, and ends what it has started."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from typing import Any

import ray
from ray import serve

from rhytid.domain.wording import plural
from rhytid.errors import DeviceError
from rhytid.fleet.app import deployment
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.ray_engine import RayEngine
from rhytid.fleet.remote_board import RemoteBoard
from rhytid.support.settings import ServiceSettings

NAME = "rhytid"
_MEMORY = 512 << 20
# The address that Ray names its parts by.
_LOOPBACK = "127.0.0.1"
_log = logging.getLogger(__name__)
# What workers log: answers to calls are logged by the server.
_LOGS = {"enable_access_log": False, "log_level": "WARNING"}


@contextmanager
def local_fleet(
    settings: ServiceSettings, options: FleetOptions, address: str | None, **ray_options: Any
) -> Iterator[RayEngine]:
    """An engine over replicas, which end with the block.

    address: of a cluster that runs already; None: Ray is started on this machine alone, without its
    dashboard, and ended with the block.  ray_options: of `ray.init`, of Ray that is started. Raises
    DeviceError where Ray or the replicas do not start.
    """
    count, board = plural(options.least, "replica"), RemoteBoard(NAME)
    _log.info("Ray starts %s, which may take a minute", count)
    try:
        with _own_signals():
            _start_ray(options, address, ray_options)
    except BaseException as error:
        ray.shutdown()  # what was started before it failed
        if not isinstance(error, Exception):
            raise
        where = "Ray does not start" if address is None else f"no Ray answers at {address}"
        raise DeviceError(f"{where}: {error}") from error
    try:
        # Of how Serve starts and ends, in words of its own.
        logging.getLogger("ray.serve").setLevel(logging.WARNING)
        serve.start(proxy_location="Disabled", logging_config=_LOGS)
        handle = _started(deployment(settings, options))
        with closing(RayEngine(settings, options, handle, board)) as engine:
            yield engine
    finally:
        with suppress(Exception):
            serve.delete(NAME)
        with suppress(Exception):
            board.end()
        if address is None:
            with suppress(Exception):
                serve.shutdown()
        ray.shutdown()


def _start_ray(options: FleetOptions, address: str | None, given: Mapping[str, Any]) -> None:
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.WARNING}
    if address is not None:
        ray.init(address=address, **quiet)
        return
    own = {"num_cpus": options.most * max(options.cpus, 1), "object_store_memory": _MEMORY}
    ray.init(include_dashboard=False, _node_ip_address=_LOOPBACK, **{**own, **quiet, **given})


@contextmanager
def _own_signals() -> Iterator[None]:
    """Ray takes SIGTERM in the block; after it, it is the server's again."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        # None: not Python has set it, and Python cannot set it again.
        if threading.current_thread() is threading.main_thread() and before is not None:
            signal.signal(signal.SIGTERM, before)


def _started(replicas: serve.Application) -> Any:
    """The handle of the replicas, once they answer."""
    try:
        return serve.run(replicas, name=NAME, route_prefix=None, logging_config=_LOGS)
    except RuntimeError as error:
        found = serve.status().applications.get(NAME)
        parts = {} if found is None else found.deployments
        told = "; ".join(part.message for part in parts.values() if part.message)
        raise DeviceError(f"the replicas do not start: {told or error}") from error
