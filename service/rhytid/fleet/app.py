"""The application of Ray Serve: for `serve run rhytid.fleet.app:application`, and for `rhytid serve
--ray`, where the server is the ingress."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from typing import Any

import ray
from ray import serve
from ray.serve import Application
from ray.serve.config import RequestRouterConfig

from rhytid.api.app import create_app
from rhytid.api.keys import has_valid_key
from rhytid.api.request_memory import WholeBytes
from rhytid.device.memory import usual_frame_memory
from rhytid.domain.wording import plural
from rhytid.errors import AccessError, DeviceError
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.ray_engine import RayEngine
from rhytid.fleet.remote_registry import RemoteFrameRegistry
from rhytid.fleet.replica import EngineReplica
from rhytid.fleet.router import AssetRouter
from rhytid.support.logs import log_to_stderr
from rhytid.support.settings import ServiceSettings

REPLICAS = "Replicas"
# Seconds between two looks of Ray at a replica, until an answer, and that calls have to finish when
# a replica is ended.
_HEALTH, _HEALTH_ANSWER, _GRACE = 2.0, 30.0, 20.0
# Calls between the parts of a fleet are many; ingresses log the requests that they are made for.
_LOGS = {"enable_access_log": False}
# Calls that wait in an ingress, for each that a replica may work on.
_QUEUED = 4
# The application of `rhytid serve --ray`, and bytes of the object store of the Ray that it starts.
NAME = "rhytid"
_MEMORY = 512 << 20
# The address that Ray names its parts by.
_LOOPBACK = "127.0.0.1"
# What workers log: answers to calls are logged by the server.
_WARNINGS = {"enable_access_log": False, "log_level": "WARNING"}
_log = logging.getLogger(__name__)


def application(given: Mapping[str, object]) -> Application:
    """An ingress over replicas, for `serve run` and `serve deploy`.

    given: options of `FleetOptions` by name; what they do not say comes from the environment of the
    machine that this runs on. Raises SettingsError; AccessError where there is no valid API key,
    StorageError where the keys cannot be read, and what `FleetStore.opened` does.
    """
    settings = ServiceSettings.from_environment()
    options = FleetOptions.read({"store": settings.store, **given})
    settings = asking(replace(settings, store=options.store), options)
    _prepare(settings, options)

    def http() -> Any:  # Serve asks whether it is a function: a partial is none
        return _http(settings, options)

    ingress = serve.deployment(num_replicas=options.ingresses, ray_actor_options={"num_cpus": 0})(
        serve.ingress(http)(Ingress)
    )
    return ingress.bind(deployment(settings, options))


def _prepare(settings: ServiceSettings, options: FleetOptions) -> None:
    """Open the shared store before many do so at once: what is wrong with it is found here, an
    earlier release's is taken over, and there is one key."""
    FleetStore.opened(settings, options).files.job_key()


def asking(settings: ServiceSettings, options: FleetOptions) -> ServiceSettings:
    """The settings of an ingress of Ray, which asks for keys unless the options say otherwise: it
    does not know who reaches Ray's proxy. Raises AccessError where no key is valid."""
    if not options.without_keys and not has_valid_key(settings.key_file):
        raise AccessError(
            f"{settings.key_file} has no valid API key, and Ray's proxy may be reached from other "
            "machines: make one with `rhytid keys create NAME`, or give without_keys=true where "
            "what is in front of it knows who may use it"
        )
    return replace(settings, ask_keys=not options.without_keys)


def deployment(settings: ServiceSettings, options: FleetOptions) -> Application:
    """The replicas. Their registry is none of it: it outlives what is deployed anew."""
    limit = (settings.frame_memory or usual_frame_memory()) * options.most
    routing = RequestRouterConfig(
        request_router_class=AssetRouter, request_router_kwargs={"spread": options.spread}
    )
    several: dict[str, Any] = {"num_replicas": options.least}
    if options.most > options.least:
        several = {"autoscaling_config": autoscaling(options)}
    replicas = serve.deployment(
        name=REPLICAS,
        ray_actor_options={"num_cpus": options.cpus, "num_gpus": options.gpus},
        max_ongoing_requests=options.calls,
        max_queued_requests=_QUEUED * options.calls,
        request_router_config=routing,
        health_check_period_s=_HEALTH,
        health_check_timeout_s=_HEALTH_ANSWER,
        graceful_shutdown_timeout_s=_GRACE,
        logging_config=_LOGS,
        **several,
    )(EngineReplica)
    return replicas.bind(settings, options, limit)


def autoscaling(options: FleetOptions) -> dict[str, Any]:
    """By how many calls wait at a replica. A replica that leaves takes what it has loaded with it,
    so that it goes late."""
    return {
        "min_replicas": options.least,
        "max_replicas": options.most,
        "target_ongoing_requests": max(options.calls // 2, 1),
        "upscale_delay_s": 15,
        "downscale_delay_s": 600,
    }


class Ingress:
    """Serves HTTP as `rhytid serve` does, and has no state that others lack.

    replicas: handle, which makes them part of the application.
    """

    def __init__(self, replicas: Any) -> None:
        self._parts = (replicas,)


def _http(settings: ServiceSettings, options: FleetOptions) -> Any:
    """The application of an ingress, made where it runs."""
    name = serve.get_replica_context().app_name
    log_to_stderr(settings.log_format, logging.INFO, "ingress")
    handle = serve.get_deployment_handle(REPLICAS, name)
    engine = RayEngine(settings, options, handle, RemoteFrameRegistry(name))
    return ingress_app(engine, settings)


def ingress_app(engine: Any, settings: ServiceSettings) -> Any:
    """The application of the single server, for Ray's proxy."""
    app = create_app(engine, settings)
    # It is in another process, where views cannot be sent.
    app.add_middleware(WholeBytes)
    return app


@contextmanager
def local_fleet(
    settings: ServiceSettings, options: FleetOptions, address: str | None, **ray_options: Any
) -> Iterator[RayEngine]:
    """An engine over replicas, which end with the block.

    address: of a cluster that runs already; None: Ray is started on this machine alone, without its
    dashboard, and ended with the block.  ray_options: of `ray.init`, of Ray that is started. Raises
    DeviceError where Ray or the replicas do not start, and what `FleetStore.opened` does.
    """
    _prepare(settings, options)
    count, registry = plural(options.least, "replica"), RemoteFrameRegistry(NAME)
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
        serve.start(proxy_location="Disabled", logging_config=_WARNINGS)
        handle = _started(deployment(settings, options))
        with closing(RayEngine(settings, options, handle, registry)) as engine:
            yield engine
    finally:
        with suppress(Exception):
            serve.delete(NAME)
        with suppress(Exception):
            registry.end()
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
        return serve.run(replicas, name=NAME, route_prefix=None, logging_config=_WARNINGS)
    except RuntimeError as error:
        found = serve.status().applications.get(NAME)
        parts = {} if found is None else found.deployments
        told = "; ".join(part.message for part in parts.values() if part.message)
        raise DeviceError(f"the replicas do not start: {told or error}") from error
