"""The settings of the process, read once from the environment: nothing else reads it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rhytid.errors import SettingsError

MIB = 1 << 20
LOG_FORMATS = ("text", "json")
# A name, all names below one, or all. No port: they are allowed with any.
_HOST = re.compile(r"\*|(?:\*\.)?[a-z0-9_-]+(?:\.[a-z0-9_-]+)*")
_ORIGIN = re.compile(r"\*|https?://(?:[a-z0-9._-]+|\[[0-9a-f:.]+\])(?::[0-9]{1,5})?")


@dataclass(frozen=True)
class ServiceSettings:
    """How this process runs.

    store: folder of the assets.  device: part of an OpenCL device's or platform's name, or the
    number that `rhytid devices` shows; None = the best that computes.
    device_memory, frame_memory, host_memory, upload_limit, spool: bytes; None = a share of what the
    device or the machine has.  host_memory: that answers and uploads hold at once.  spool: of
    uploads on disk at once.  packages: of skin packages that are kept.
    queue: waiting device requests at most.  jobs: waiting jobs at most.
    draw_seconds: that the map of a UDIM may take, by an estimate; graphs beyond it are refused.
    cache: folder for what is measured of the device once; None = nothing is measured.
    keys: file of the API keys; None = `keys.json` in the store.  ask_keys: None = once there is
    such a file.  hosts: names that the server may be called by, beside `localhost` and addresses.
    origins: of web pages from elsewhere that may use it.  key_rate: requests per second, key_jobs:
    unfinished jobs, of one key, or of one address where no key is asked for.
    devices: numbers of devices that `rhytid serve` uses at once, or `all`; none = the one that
    `device` says.  launch_seconds: that one call of the OpenCL driver may take before `rhytid
    serve` ends the process of the device.  stall_seconds: without progress after which a client is
    disconnected.  connections: open at once; one address may have half of them.  drain_seconds:
    that requests have to finish once the server is told to end.  log_format: of the log of `rhytid
    serve`, text or json.  traces: where OpenTelemetry sends spans; None = nowhere.
    """

    store: Path = Path("rhytid-store")
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
    draw_seconds: int = 60
    cache: Path | None = None
    launch_seconds: int = 60
    drain_seconds: int = 20
    log_format: str = "text"
    traces: str | None = None
    stall_seconds: float = 30
    connections: int = 1024
    keys: Path | None = None
    ask_keys: bool | None = None
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()
    key_rate: int = 1000
    key_jobs: int = 64

    @property
    def key_file(self) -> Path:
        """Where the API keys are, if there are any."""
        return self.keys or self.store / "keys.json"

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> ServiceSettings:
        """Read RHYTID_STORE, RHYTID_DEVICE, RHYTID_DEVICE_MEMORY_MB, RHYTID_FRAME_MEMORY_MB,
        RHYTID_HOST_MEMORY_MB, RHYTID_UPLOAD_LIMIT_MB, RHYTID_SPOOL_MB, RHYTID_PACKAGES_MB,
        RHYTID_QUEUE, RHYTID_JOBS,
        RHYTID_DRAW_SECONDS, RHYTID_CACHE, RHYTID_LAUNCH_SECONDS, RHYTID_STALL_SECONDS,
        RHYTID_CONNECTIONS, RHYTID_DRAIN_SECONDS, RHYTID_LOG_FORMAT, RHYTID_KEYS_FILE,
        RHYTID_ALLOWED_HOSTS, RHYTID_CORS_ORIGINS, RHYTID_KEY_RATE, RHYTID_KEY_JOBS and
        OTEL_EXPORTER_OTLP_ENDPOINT; raises SettingsError naming the variable, also where an upload
        of the largest size allowed would not fit into the spool."""

        def count(name: str, default: int) -> int:
            return optional(name) or default

        def memory(name: str) -> int | None:
            value = optional(name)
            return None if value is None else value * MIB

        def optional(name: str) -> int | None:
            value = environment.get(name)
            if not value:
                return None
            if not (value.isascii() and value.isdigit() and 0 < int(value) < 2**40):
                raise SettingsError(f"{name} is {value!r}: must be a whole number above 0")
            return int(value)

        upload_limit = count("RHYTID_UPLOAD_LIMIT_MB", 1024)
        spool = count("RHYTID_SPOOL_MB", 4096)
        if upload_limit > spool:
            raise SettingsError(
                f"RHYTID_UPLOAD_LIMIT_MB is {upload_limit}: must be at most RHYTID_SPOOL_MB, "
                f"which is {spool}; an upload of that size would not fit on the disk allowed"
            )

        def several(name: str, form: re.Pattern[str]) -> tuple[str, ...]:
            given = [one.strip().lower() for one in (environment.get(name) or "").split(",")]
            wrong = [one for one in given if one and not form.fullmatch(one)]
            if wrong:
                example = "http://localhost:5173" if form is _ORIGIN else "skin.studio.example"
                raise SettingsError(f"{name} has {wrong[0]!r}: must be like {example}, or *")
            return tuple(one for one in given if one)

        return cls(
            store=Path(environment.get("RHYTID_STORE") or "rhytid-store"),
            device=environment.get("RHYTID_DEVICE") or None,
            device_memory=memory("RHYTID_DEVICE_MEMORY_MB"),
            frame_memory=memory("RHYTID_FRAME_MEMORY_MB"),
            host_memory=memory("RHYTID_HOST_MEMORY_MB"),
            upload_limit=upload_limit * MIB,
            spool=spool * MIB,
            packages=count("RHYTID_PACKAGES_MB", 4096) * MIB,
            queue=count("RHYTID_QUEUE", 256),
            jobs=count("RHYTID_JOBS", 256),
            draw_seconds=count("RHYTID_DRAW_SECONDS", 60),
            cache=_folder(environment.get("RHYTID_CACHE")),
            launch_seconds=count("RHYTID_LAUNCH_SECONDS", 60),
            drain_seconds=count("RHYTID_DRAIN_SECONDS", 20),
            log_format=_log_format(environment.get("RHYTID_LOG_FORMAT") or "text"),
            traces=environment.get("OTEL_EXPORTER_OTLP_ENDPOINT") or None,
            stall_seconds=count("RHYTID_STALL_SECONDS", 30),
            connections=count("RHYTID_CONNECTIONS", 1024),
            keys=Path(keys) if (keys := environment.get("RHYTID_KEYS_FILE")) else None,
            hosts=several("RHYTID_ALLOWED_HOSTS", _HOST),
            origins=several("RHYTID_CORS_ORIGINS", _ORIGIN),
            key_rate=count("RHYTID_KEY_RATE", 1000),
            key_jobs=count("RHYTID_KEY_JOBS", 64),
        )


def _log_format(named: str) -> str:
    if named not in LOG_FORMATS:
        raise SettingsError(f"RHYTID_LOG_FORMAT is {named!r}: one of {', '.join(LOG_FORMATS)}")
    return named


def _folder(named: str | None) -> Path | None:
    """RHYTID_CACHE; else a folder in the user's home, or None where there is none."""
    try:
        return Path(named or "~/.cache/rhytid").expanduser()
    except RuntimeError as exc:
        if named:
            raise SettingsError(f"RHYTID_CACHE is {named!r}: {exc}") from exc
        return None
