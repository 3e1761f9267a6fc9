"""Who may call what: one table from route to scope, and the guard that every route runs first."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from functools import lru_cache

from fastapi.requests import HTTPConnection
from starlette.types import Scope

from rhytid.access.api_key import ADMIN, COMPUTE, READ, ApiKey
from rhytid.access.key_ring import KeyRing
from rhytid.api.rates import Rates
from rhytid.engine import callers
from rhytid.errors import AccessError, ApiKeyError, QuotaError, RhytidError, ScopeError
from rhytid.support.settings import ServiceSettings

OPEN = "open"
# Open, and never refused for coming too often: who asks it restarts a server that refuses.
ALIVE = "/healthz"
# The scope that a caller needs, by method and path. HEAD is as GET. A route that is not here
# answers nobody. read: asks for what is known and for drawings of it. compute: sends what is to be
# used. admin: removes what others use, or vouches for it: nobody can check that the wrinkles of a
# snapshot are those that its mesh grows.
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


@dataclass(frozen=True)
class Caller:
    """Who asks: a key or an address.  rate: requests per second, jobs: unfinished, at most."""

    name: str
    rate: int
    jobs: int

    @classmethod
    def of(cls, scope: Scope) -> Caller:
        """Of a request that the guard let in."""
        caller: Caller = scope[CALLER]
        return caller


class Access:
    """Lets callers in by their keys, as often as they may ask."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._rate, self._jobs = settings.key_rate, settings.key_jobs
        self._rates = Rates()
        self._ring = None
        if settings.ask_keys is not False:
            asked = settings.ask_keys is True
            self._ring = KeyRing(settings.key_file, asked=asked, mark=settings.key_mark)

    async def fresh(self) -> None:
        """Look at the keys where it is time to, before `admit`."""
        if self._ring is not None:
            await self._ring.fresh()

    def admit(self, scope: Scope, needed: str) -> None:
        """Let a caller in who may do what `needed` names, by the keys that `fresh` has found.

        Raises ApiKeyError, ScopeError, QuotaError, and StorageError where the keys cannot be read.
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


async def guard(connection: HTTPConnection) -> None:
    """A dependency of the whole app: every route runs it before anything of the request is read."""
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
        await access.fresh()
    access.admit(scope, needed)
    callers.caller.set(Caller.of(scope).name)


def _keys_offered(scope: Scope) -> list[bytes]:
    """Keys among the subprotocols that a WebSocket offers, as Authorization would have them."""
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
    except ValueError:  # what a proxy passed on
        return "address unknown"
    if address.version == 4:
        return f"address {address}"
    return f"address {ipaddress.ip_network((address, _NETWORK), strict=False)}"
