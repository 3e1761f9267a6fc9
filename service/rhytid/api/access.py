"""Who may call what, and how often: a table from route to scope, the guard that every route runs
first, and the keys as the server knows them, read again when their file changes."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from fastapi.requests import HTTPConnection
from starlette.types import Scope

from rhytid.api.keys import (
    ADMIN,
    COMPUTE,
    READ,
    ApiKey,
    key_id,
    leave_mark,
    proves,
    read_keys,
    utc_now,
)
from rhytid.engine import call_context
from rhytid.errors import (
    AccessError,
    ApiKeyError,
    QuotaError,
    RhytidError,
    ScopeError,
    StorageError,
)
from rhytid.support.settings import ServiceSettings

OPEN = "open"
# Open, and without a limit of rate: a watcher of the server restarts it where this is refused.
ALIVE = "/healthz"
# The scope that a caller needs, by method and path. HEAD counts as GET. A route that is not here
# answers nobody. read: asks for assets, frames and drawings. compute: sends meshes and frames.
# admin: removes assets that others use, or vouches for one: nobody can check that the wrinkles of
# a snapshot are those that its mesh grows.
ROUTES = {
    "GET /": OPEN,
    "GET /healthz": OPEN,
    "GET /readyz": OPEN,
    "GET /docs": OPEN,
    "GET /docs/{file}": OPEN,
    "GET /viewer/{file}": OPEN,
    "GET /metrics": READ,
    "GET /v1/devices": READ,
    "GET /v1/memory": READ,
    "GET /v1/assets": READ,
    "POST /v1/assets": COMPUTE,
    "GET /v1/assets/{asset}": READ,
    "PATCH /v1/assets/{asset}": COMPUTE,
    "DELETE /v1/assets/{asset}": ADMIN,
    "GET /v1/assets/{asset}/graph": READ,
    "GET /v1/assets/{asset}/mesh": READ,
    "GET /v1/assets/{asset}/snapshot": READ,
    "GET /v1/assets/{asset}/package": READ,
    "GET /v1/assets/{asset}/package/{path}": READ,
    "POST /v1/snapshots": ADMIN,
    "GET /v1/assets/{asset}/frames": READ,
    "GET /v1/assets/{asset}/frames/{frame}": READ,
    "PUT /v1/assets/{asset}/frames/{frame}": COMPUTE,
    "DELETE /v1/assets/{asset}/frames/{frame}": COMPUTE,
    "GET /v1/assets/{asset}/frames/{frame}/stretch": READ,
    "GET /v1/assets/{asset}/frames/{frame}/tiles/{udim}/{level}/{row}/{column}": READ,
    "GET /v1/assets/{asset}/frames/{frame}/maps/{udim}": READ,
    "PUT /v1/assets/{asset}/calibration": COMPUTE,
    "POST /v1/assets/{asset}/tiles": COMPUTE,
    "WS /v1/assets/{asset}/live": COMPUTE,
    "GET /v1/assets/{asset}/bins": READ,
    "GET /v1/assets/{asset}/bins/{udim}/{level}/{row}/{column}": READ,
    "GET /v1/jobs/{job}": READ,
    "GET /v1/jobs/{job}/events": READ,
    "DELETE /v1/jobs/{job}": COMPUTE,
}
CALLER = "rhytid.caller"
# Web pages cannot set headers of a WebSocket but for its subprotocols: one of these may be a key.
KEY_PROTOCOL = b"rhytid.key."
# An address of IPv6 is one of 2⁶⁴ that a caller has.
_NETWORK = 64
# Seconds that a caller may save up.
SAVED = 2.0
# Callers that are remembered; whoever asked longest ago is forgotten first, and has saved most.
REMEMBERED = 10_000
# Seconds between two looks at the file, and for a look that requests wait for.
EVERY, PATIENCE = 1.0, 5.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Caller:
    """A caller: a key or an address.  rate: most requests per second.  jobs: most unfinished
    jobs."""

    name: str
    rate: int
    jobs: int

    @classmethod
    def of(cls, scope: Scope) -> Caller:
        """Return the caller of a request that the guard let in."""
        caller: Caller = scope[CALLER]
        return caller


async def guard(connection: HTTPConnection) -> None:
    """Let the caller of a request in, or refuse it. A dependency of the whole app: every route runs
    it before anything else of the request is read.

    Raises what `Access.admit` does, and RhytidError for a route that has no row in ROUTES.
    """
    scope = connection.scope
    method = "GET" if scope.get("method") == "HEAD" else scope.get("method", "WS")
    path = scope["route"].path_format
    if path == ALIVE:
        return
    needed = ROUTES.get(f"{method} {path}")
    if needed is None:
        raise RhytidError(f"{method} {path} is in no row of the table of scopes")
    access: Access = connection.app.state.access
    if needed != OPEN:
        await access.refresh()
    access.admit(scope, needed)
    call_context.caller.set(Caller.of(scope).name)


class Access:
    """Checks the keys of callers, and how often each of them asks."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._rate, self._jobs = settings.key_rate, settings.key_jobs
        self._rates = RateLimiter()
        self._ring = None
        if settings.ask_keys is not False:
            asked = settings.ask_keys is True
            self._ring = KeyRing(settings.key_file, asked=asked, mark=settings.key_mark)

    async def refresh(self) -> None:
        """Read the file of the keys again where it has changed; call it before `admit`."""
        if self._ring is not None:
            await self._ring.refresh()

    def admit(self, scope: Scope, needed: str) -> None:
        """Let a caller in that has the scope `needed`, by the keys that the last `refresh` found.

        Raises ApiKeyError without a valid key, ScopeError where the key lacks the scope, QuotaError
        above the rate of the caller, and StorageError where the keys cannot be read.
        """
        address = Caller(_address(scope), self._rate, self._jobs)
        caller = address
        refusal: AccessError | None = None
        if needed != OPEN and self._ring is not None and self._ring.asked:
            try:
                key = self._key(scope, self._ring)
                caller = Caller(f"key {key.id}", key.rate or self._rate, key.jobs or self._jobs)
                refusal = _lacking(key, needed)
            except ApiKeyError as error:
                refusal = error
        scope[CALLER] = caller
        wait = self._rates.take(caller.name, caller.rate)
        if wait:
            raise QuotaError(f"{caller.name} sends more than {caller.rate} requests a second", wait)
        if refusal is not None:
            raise refusal

    def _key(self, scope: Scope, ring: KeyRing) -> ApiKey:
        shown = [value for name, value in scope["headers"] if name == b"authorization"]
        shown += _keys_offered(scope)
        if not shown:
            raise ApiKeyError("an API key is needed: send 'Authorization: Bearer KEY'")
        scheme, _, value = shown[0].partition(b" ")
        key = ring.find(value.strip()) if scheme.lower() == b"bearer" and len(shown) == 1 else None
        if key is None:
            raise ApiKeyError("Authorization holds no API key that is valid here now")
        return key


def _keys_offered(scope: Scope) -> list[bytes]:
    """Keys among the subprotocols that a WebSocket offers, in the form of an Authorization
    header."""
    offered = (one.encode("latin-1", "replace") for one in scope.get("subprotocols", ()))
    found = (one for one in offered if one.startswith(KEY_PROTOCOL))
    return [b"Bearer " + one[len(KEY_PROTOCOL) :] for one in found]


def _lacking(key: ApiKey, needed: str) -> ScopeError | None:
    if needed in key.scopes:
        return None
    has = ", ".join(sorted(key.scopes))
    return ScopeError(f"this needs a key with the scope {needed}: the key {key.name} has {has}")


def _address(scope: Scope) -> str:
    return _caller_at((scope.get("client") or ("unknown", 0))[0])


@lru_cache(1024)
def _caller_at(host: str) -> str:
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:  # a proxy has passed on a name
        return "address unknown"
    if address.version == 4:
        return f"address {address}"
    return f"address {ipaddress.ip_network((address, _NETWORK), strict=False)}"


@dataclass(frozen=True)
class _Known:
    """The keys as the last look at the file found them.  asked: whether a key is asked for.
    trouble: why the keys cannot be read; empty where they can."""

    asked: bool
    keys: Mapping[str, ApiKey] = field(default_factory=dict)
    trouble: str = ""


class KeyRing:
    """The keys of a file, as of the last `look` or `refresh`. One thread asks, another may look.

    A caller without a key is let in as long as there has never been a file. Once a file was seen a
    key is asked for, even when the file is gone again. A file that cannot be read lets nobody in.

    asked: True = a key is asked for whether there is a file or not.  every: seconds between two
    looks.  patience: seconds that a request waits for a look.  mark: a file that is left once keys
    were read, where its folder exists; None = none.
    """

    def __init__(
        self,
        path: Path,
        *,
        asked: bool = False,
        every: float = EVERY,
        patience: float = PATIENCE,
        mark: Path | None = None,
    ) -> None:
        self._path, self._every, self._patience, self._mark = path, every, patience, mark
        self._known = _Known(asked)
        # Facts of the file when it was last read; None = it must be read.
        self._seen: tuple[int, ...] | None = None
        self._next = 0.0
        # The look of a thread, and until when requests wait for it.
        self._looking: Future[None] | None = None
        self._until = 0.0

    @property
    def asked(self) -> bool:
        """Whether a key is asked for."""
        return self._known.asked

    def find(self, shown: bytes) -> ApiKey | None:
        """Return the valid key that was shown, or None; raises StorageError where the file cannot
        be read."""
        known = self._known
        if known.trouble:
            raise StorageError(f"the API keys of {self._path} cannot be read")
        kept = known.keys.get(key_id(shown) or "")
        return kept if proves(shown, kept) and kept is not None and kept.valid(utc_now()) else None

    async def refresh(self) -> None:
        """Look at the file, on a thread because its file system may hang, if the last look is
        `every` seconds old. Nobody is let in while a look takes longer than `patience`."""
        if self._looking is not None and self._looking.done():
            self._looking = None
        now = time.monotonic()
        if self._looking is None:
            if now < self._next:
                return
            self._looking, self._until = self._begun(), now + self._patience
        looking = self._looking
        if not looking.done() and now < self._until:
            await asyncio.wait([asyncio.wrap_future(looking)], timeout=self._until - now)
        if not looking.done():
            rule = f"{self._path} was not read within {self._patience:g} seconds"
            self._learn(replace(self._known, asked=True, keys={}, trouble=rule))

    def _begun(self) -> Future[None]:
        """Begin a look on a thread of its own, which ends with the process."""
        done: Future[None] = Future()

        def run() -> None:
            try:
                self.look()
            finally:
                done.set_result(None)

        threading.Thread(target=run, name="rhytid-keys", daemon=True).start()
        return done

    def look(self) -> None:
        """Look at the file if the last look is `every` seconds old; may block."""
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + self._every
        seen = self._facts()
        if seen is None or seen != self._seen or self._known.trouble:
            self._seen = seen
            self._read()

    def _read(self) -> None:
        try:
            keys = {key.id: key for key in read_keys(self._path)}
        except FileNotFoundError:
            self._learn(_Known(self._known.asked))
        except StorageError as error:
            self._seen = None
            self._learn(_Known(asked=True, trouble=str(error)))
        else:
            self._learn(_Known(asked=True, keys=keys))
            self._leave_mark()

    def _learn(self, known: _Known) -> None:
        before, self._known = self._known.trouble, known
        if known.trouble and known.trouble != before:
            _log.error("nobody is let in: %s", known.trouble)

    def _leave_mark(self) -> None:
        if self._mark is not None and self._mark.parent.is_dir():
            try:
                leave_mark(self._mark)
            except StorageError as error:
                _log.warning("%s", error)

    def _facts(self) -> tuple[int, ...] | None:
        """The facts of the file that change with it; empty where there is no file, None where it
        cannot be seen."""
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return ()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size


class RateLimiter:
    """A token bucket for each caller, in bounded memory. For one thread.

    clock: a clock in seconds that never goes back.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # Requests that each caller had left, and at which time.
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str, rate: float) -> int:
        """Return 0 where the caller may ask now; else the seconds after which it may, at least 1.

        rate: requests per second; `SAVED` times as many may come at once.
        """
        now, most = self._clock(), max(SAVED * rate, 1.0)
        left, then = self._left.get(caller, (most, now))
        left = min(left + (now - then) * rate, most)
        allowed = left >= 1.0
        self._left[caller] = (left - allowed, now)
        self._left.move_to_end(caller)
        if len(self._left) > REMEMBERED:
            self._left.popitem(last=False)
        return 0 if allowed else math.ceil((1.0 - left) / rate)

    def __len__(self) -> int:
        return len(self._left)
