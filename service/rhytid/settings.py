"""The settings of the process, read once from the environment: nothing else reads it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from rhytid.errors import SettingsError
from rhytid.variables import MIB, Variables

LOG_FORMATS = ("text", "json")
_PREFIX = "RHYTID_"
# Of uvicorn, which `rhytid serve` overrides.
_INSTEAD = {"FORWARDED_ALLOW_IPS": "RHYTID_PROXIES"}
# Of names without the prefix: 1 is the same.
_ALIKE = 0.75
# Seconds that a build of a server may take, unless it is told otherwise.
BUILD_SECONDS = 7200


@dataclass(frozen=True)
class ServiceSettings:
    """How this process runs.

    store: folder of the assets.  shared_store: where assets are that several machines share, a
    folder or s3://BUCKET/PREFIX, whose copies `store` then holds; None = nowhere.
    store_limit: bytes of these copies; None = any.  in_step: whether machines wait until the shared
    store has what they built or changed, as the replicas of a fleet do.
    device: part of an OpenCL device's or platform's name, or the number that `rhytid devices`
    shows; None = the best that computes.
    device_memory, frame_memory, host_memory, upload_limit, spool: bytes; None = a share of what the
    device or the machine has.  host_memory: that answers and uploads hold at once.  spool: of
    uploads on disk at once.  packages: of skin packages that are kept.
    queue: waiting device requests at most.  jobs: waiting jobs at most.
    build_seconds: that a build may take; None: any.
    draw_seconds: that the map of a UDIM may take, by an estimate; graphs beyond it are refused.
    cache: folder for what is measured of the device once; None = nothing is measured.
    keys: file of the API keys; None = `keys.json` in the store.  ask_keys: None = once there is
    such a file.  hosts: names that the server may be called by, beside `localhost` and addresses.
    origins: of web pages from elsewhere that may use it.  proxies: addresses and networks whose
    X-Forwarded-For and X-Forwarded-Proto are believed.  key_rate: requests per second, key_jobs:
    unfinished jobs, of one key, or of one address where no key is asked for.
    devices: numbers of devices that `rhytid serve` uses at once, or `all`; none = the one that
    `device` says.  launch_seconds: that one call of the OpenCL driver may take before `rhytid
    serve` ends the process of the device.  stall_seconds: without progress after which a client is
    disconnected.  connections: open at once; one address that is no proxy may have half of them.
    drain_seconds: that requests have to finish once the server is told to end.  log_format: of the
    log of `rhytid serve`, text or json.  traces: where OpenTelemetry sends spans; None = nowhere.
    trace_kernels: a span for each kernel and each wait of a request, not one for all of them.
    """

    store: Path = Path("rhytid-store")
    shared_store: str | None = None
    store_limit: int | None = None
    in_step: bool = False
    device: str | None = None
    devices: tuple[str, ...] = ()
    device_memory: int | None = None
    frame_memory: int | None = None
    host_memory: int | None = None
    upload_limit: int = 1024 * MIB
    spool: int = 4096 * MIB
    packages: int = 4096 * MIB
    queue: int = 256
    jobs: int = 256
    build_seconds: int | None = None
    draw_seconds: int = 60
    cache: Path | None = None
    launch_seconds: int = 60
    drain_seconds: int = 20
    log_format: str = "text"
    traces: str | None = None
    trace_kernels: bool = False
    stall_seconds: float = 30
    connections: int = 1024
    keys: Path | None = None
    ask_keys: bool | None = None
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()
    proxies: tuple[str, ...] = ()
    key_rate: int = 1000
    key_jobs: int = 64

    @property
    def key_file(self) -> Path:
        """Where the API keys are, if there are any."""
        return self.keys or self.store / "keys.json"

    @property
    def key_mark(self) -> Path:
        """A file of the store that is there once the server has asked for keys."""
        return self.store / "keys.json.asked"

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> ServiceSettings:
        """Read RHYTID_STORE, RHYTID_SHARED_STORE, RHYTID_STORE_MB, RHYTID_DEVICE,
        RHYTID_DEVICE_MEMORY_MB, RHYTID_FRAME_MEMORY_MB, RHYTID_HOST_MEMORY_MB,
        RHYTID_UPLOAD_LIMIT_MB, RHYTID_SPOOL_MB, RHYTID_PACKAGES_MB, RHYTID_QUEUE, RHYTID_JOBS,
        RHYTID_BUILD_SECONDS, RHYTID_DRAW_SECONDS, RHYTID_CACHE, RHYTID_LAUNCH_SECONDS,
        RHYTID_STALL_SECONDS,
        RHYTID_CONNECTIONS, RHYTID_DRAIN_SECONDS, RHYTID_LOG_FORMAT, RHYTID_KEYS_FILE,
        RHYTID_ALLOWED_HOSTS, RHYTID_CORS_ORIGINS, RHYTID_PROXIES, RHYTID_KEY_RATE,
        RHYTID_KEY_JOBS, RHYTID_TRACE_KERNELS and OTEL_EXPORTER_OTLP_ENDPOINT; raises
        SettingsError naming the variable, also where an upload of the largest size allowed would
        not fit into the spool."""
        return cls._of(Variables(environment))

    @classmethod
    def _of(cls, given: Variables) -> ServiceSettings:
        upload_limit, spool = _upload_limits(given)
        return cls(
            store=given.path("RHYTID_STORE") or cls.store,
            shared_store=given.text("RHYTID_SHARED_STORE"),
            store_limit=given.mebibytes("RHYTID_STORE_MB"),
            device=given.text("RHYTID_DEVICE"),
            device_memory=given.mebibytes("RHYTID_DEVICE_MEMORY_MB"),
            frame_memory=given.mebibytes("RHYTID_FRAME_MEMORY_MB"),
            host_memory=given.mebibytes("RHYTID_HOST_MEMORY_MB"),
            upload_limit=upload_limit,
            spool=spool,
            packages=given.mebibytes("RHYTID_PACKAGES_MB") or cls.packages,
            queue=given.count("RHYTID_QUEUE", cls.queue),
            jobs=given.count("RHYTID_JOBS", cls.jobs),
            build_seconds=given.count("RHYTID_BUILD_SECONDS", BUILD_SECONDS),
            draw_seconds=given.count("RHYTID_DRAW_SECONDS", cls.draw_seconds),
            cache=given.home_folder("RHYTID_CACHE", "~/.cache/rhytid"),
            launch_seconds=given.count("RHYTID_LAUNCH_SECONDS", cls.launch_seconds),
            drain_seconds=given.count("RHYTID_DRAIN_SECONDS", cls.drain_seconds),
            log_format=given.choice("RHYTID_LOG_FORMAT", LOG_FORMATS),
            traces=given.text("OTEL_EXPORTER_OTLP_ENDPOINT"),
            trace_kernels=given.choice("RHYTID_TRACE_KERNELS", ("no", "yes")) == "yes",
            stall_seconds=given.number("RHYTID_STALL_SECONDS") or cls.stall_seconds,
            connections=given.count("RHYTID_CONNECTIONS", cls.connections),
            keys=given.path("RHYTID_KEYS_FILE"),
            hosts=given.hosts("RHYTID_ALLOWED_HOSTS"),
            origins=given.origins("RHYTID_CORS_ORIGINS"),
            proxies=given.networks("RHYTID_PROXIES"),
            key_rate=given.count("RHYTID_KEY_RATE", cls.key_rate),
            key_jobs=given.count("RHYTID_KEY_JOBS", cls.key_jobs),
        )


def misspelt(environment: Mapping[str, str] = os.environ) -> list[str]:
    """What to say of variables that are not read, where one that is has nearly their name or stands
    for them. Others that begin alike are left alone: Kubernetes makes RHYTID_PORT of a Service."""
    given = Variables({})
    ServiceSettings._of(given)
    known = [name for name in given.asked if name.startswith(_PREFIX)]
    said = []
    for name, instead in _INSTEAD.items():
        if environment.get(name) and not environment.get(instead):
            said.append(f"{name} is not read: {instead} stands for it")
    for name in environment:
        if name.startswith(_PREFIX) and name not in known:
            ends = [one.removeprefix(_PREFIX) for one in known]
            near = get_close_matches(name.removeprefix(_PREFIX), ends, 1, _ALIKE)
            said += [f"{name} is not known: did you mean {_PREFIX}{one}?" for one in near]
    return said


def _upload_limits(given: Variables) -> tuple[int, int]:
    """Bytes of one upload, and of all on disk at once."""
    upload = given.count("RHYTID_UPLOAD_LIMIT_MB", ServiceSettings.upload_limit // MIB)
    spool = given.count("RHYTID_SPOOL_MB", ServiceSettings.spool // MIB)
    if upload > spool:
        raise SettingsError(
            f"RHYTID_UPLOAD_LIMIT_MB is {upload}: must be at most RHYTID_SPOOL_MB, "
            f"which is {spool}; an upload of that size would not fit on the disk allowed"
        )
    return upload * MIB, spool * MIB
