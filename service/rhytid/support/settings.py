"""The settings of the process, read once from the environment; no other module reads it."""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from rhytid.errors import SettingsError

MIB = 1 << 20
LOG_FORMATS = ("text", "json")
_PREFIX = "RHYTID_"
# Of uvicorn, which `rhytid serve` overrides.
_INSTEAD = {"FORWARDED_ALLOW_IPS": "RHYTID_PROXIES"}
# Of names without the prefix: 1 is the same.
_ALIKE = 0.75
# Seconds that a build of a server may take, unless it is told otherwise.
BUILD_SECONDS = 7200
# A name, all names below one, or all. No port: they are allowed with any.
_HOST = re.compile(r"\*|(?:\*\.)?[a-z0-9_-]+(?:\.[a-z0-9_-]+)*")
_ORIGIN = re.compile(r"\*|https?://(?:[a-z0-9._-]+|\[[0-9a-f:.]+\])(?::[0-9]{1,5})?")


@dataclass(frozen=True)
class ServiceSettings:
    """How this process runs. Sizes are in bytes.

    store: folder of the assets.  shared_store: the store of assets that several machines share, a
    folder or s3://BUCKET/PREFIX, of which `store` then holds copies; None for none.
    store_limit: most size of these copies; None for no limit.
    in_step: whether machines wait until the shared store has what they built or changed, as the
    replicas of a fleet do.

    device: part of the name of an OpenCL device or platform, or the number that `rhytid devices`
    shows; None for the best that computes.  devices: numbers of the devices that `rhytid serve`
    uses at once, or `all`; empty for the one of `device`.
    device_memory, frame_memory, host_memory: most memory on the device, of frames, and that answers
    and uploads hold at once; None for a share of what the device or the machine has.

    upload_limit: most size of an upload.  spool: most size of all uploads on disk at once.
    packages: most size of the skin packages that are kept.
    queue: most requests that wait for the device.  jobs: most jobs that wait.
    build_seconds: most time of a build; None for no limit.
    draw_seconds: most time of the map of a UDIM, by an estimate; graphs beyond it are refused.
    cache: folder of what is measured of the device once; None to measure nothing.
    launch_seconds: most time of one call of the OpenCL driver, after which `rhytid serve` ends the
    process of the device.  drain_seconds: time that requests have to finish once the server is told
    to end.

    log_format: of the log of `rhytid serve`, text or json.  traces: address to which OpenTelemetry
    sends spans; None for nowhere.  trace_kernels: make a span for each kernel and each wait of a
    request, not one for all of them.
    stall_seconds: time without progress after which a client is disconnected.
    connections: most open at once; one address that is no proxy may have half of them.

    keys: file of the API keys; None for `keys.json` in the store.  ask_keys: whether requests need
    a key; None for once there is such a file.
    hosts: names that the server may be called by, beside `localhost` and addresses.
    origins: of web pages from elsewhere that may use the server.  proxies: addresses and networks
    whose X-Forwarded-For and X-Forwarded-Proto are believed.
    key_rate, key_jobs: most requests per second and most unfinished jobs of one key, or of one
    address where no key is asked for.
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


def misspelt_variables(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Messages about variables that are set and not read: a known one has nearly their name, or
    stands for them.

    Others with our prefix are left alone: Kubernetes makes RHYTID_PORT of a Service.
    """
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


class Variables:
    """Environment variables, each read as the kind of value that it holds.

    Every method raises SettingsError naming the variable. An empty variable counts as absent.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = environment
        # Names that were asked for.
        self.asked: set[str] = set()

    def text(self, name: str) -> str | None:
        """The value as it is written; None where the variable is absent."""
        self.asked.add(name)
        return self._environment.get(name) or None

    def path(self, name: str) -> Path | None:
        """A file or a folder."""
        given = self.text(name)
        return None if given is None else Path(given)

    def number(self, name: str) -> int | None:
        """A whole number from 1 to 2**40 - 1."""
        value = self.text(name)
        if value is None:
            return None
        if not (value.isascii() and value.isdigit() and 0 < int(value) < 2**40):
            raise SettingsError(f"{name} is {value!r}: must be a whole number above 0")
        return int(value)

    def count(self, name: str, default: int) -> int:
        """As `number`, with a default."""
        return self.number(name) or default

    def mebibytes(self, name: str) -> int | None:
        """A number of bytes, of a variable that holds MiB."""
        value = self.number(name)
        return None if value is None else value * MIB

    def choice(self, name: str, choices: tuple[str, ...]) -> str:
        """One of a few words; the first of them where the variable is absent."""
        value = self.text(name) or choices[0]
        if value not in choices:
            raise SettingsError(f"{name} is {value!r}: one of {', '.join(choices)}")
        return value

    def hosts(self, name: str) -> tuple[str, ...]:
        """Names of hosts with commas between, in lower case."""
        return self._several(name, _HOST, "skin.studio.example")

    def origins(self, name: str) -> tuple[str, ...]:
        """Origins of web pages with commas between, in lower case."""
        return self._several(name, _ORIGIN, "http://localhost:5173")

    def networks(self, name: str) -> tuple[str, ...]:
        """Addresses, and networks as 10.0.0.0/8, with commas between."""
        given = [one.strip() for one in (self.text(name) or "").split(",")]
        for one in filter(None, given):
            _check_network(name, one)
        return tuple(filter(None, given))

    def home_folder(self, name: str, default: str) -> Path | None:
        """A folder, in which `~` is the user's home. None where the default is used and there is no
        home."""
        given = self.text(name)
        try:
            return Path(given or default).expanduser()
        except RuntimeError as exc:
            if given:
                raise SettingsError(f"{name} is {given!r}: {exc}") from exc
            return None

    def _several(self, name: str, form: re.Pattern[str], example: str) -> tuple[str, ...]:
        given = [one.strip().lower() for one in (self.text(name) or "").split(",")]
        wrong = [one for one in given if one and not form.fullmatch(one)]
        if wrong:
            raise SettingsError(f"{name} has {wrong[0]!r}: must be like {example}, or *")
        return tuple(one for one in given if one)


def _check_network(name: str, given: str) -> None:
    try:
        ipaddress.ip_network(given)
    except ValueError as exc:
        rule = "must be an address or a network, such as 10.1.2.3 or 10.1.0.0/16"
        raise SettingsError(f"{name} has {given!r}: {rule}") from exc
