"""Heads of requests, checked before any route sees them; and the id of each request.

The id is the client's, or a new one; the log, problems and the answer have it.

A request is refused by its host, its origin or its framing. Host: a web page whose name was made to
lead here (DNS rebinding) calls the server by that name. An address in place of a name cannot be
rebound: a browser sends it only to that address. Origin: a web page of another server may send some
requests (a form with files) without asking. Framing: a length beside chunks means one thing to a
proxy and another to the server behind it.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Awaitable, Iterable
from functools import lru_cache

from fastapi import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.api.problems import problem
from rhytid.support.logs import request_id

Headers = Iterable[tuple[bytes, bytes]]
LOCAL = ("localhost", "*.localhost")
# A host with its port is not longer.
_LONGEST = 262
_HOST = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([^\s:\[\]@/?#,]+))(?::[0-9]{0,5})?", re.ASCII)
HEADER = "X-Request-Id"
_NAME = HEADER.lower().encode()
# Characters that need no quotes in a header, in a log and in a label.
_FORM = re.compile(rb"[A-Za-z0-9._~+/=:-]{1,128}")


class CheckHead:
    """ASGI middleware: refuses a request under an unknown host name, from another server's web
    page, with a length beside chunks, or with a compressed body.

    hosts: names as `skin.example`, `*.example` or `*`.  origins: as `https://pages.example` or `*`.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str], origins: Iterable[str]) -> None:
        self._app = app
        self._hosts = (*LOCAL, *hosts)
        self._origins = frozenset(origins)
        # A server is called by few different names.
        self._known = lru_cache(256)(self._is_known)

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on, or answer it with a problem."""
        if scope["type"] in ("http", "websocket"):
            refusal = self._refusal(scope["headers"])
            if refusal is not None:
                return refusal(scope, receive, send)
        return self._app(scope, receive, send)

    def _refusal(self, headers: Headers) -> Response | None:
        host: list[bytes] = []
        origin, coding, framing = None, b"", set()
        for name, value in headers:
            if name == b"host":
                host.append(value)
            elif name == b"origin":
                origin = value
            elif name == b"content-encoding":
                coding = value
            elif name in (b"content-length", b"transfer-encoding"):
                framing.add(name)
        if len(framing) > 1:
            detail = "Content-Length and Transfer-Encoding are both there: send one of them"
            return problem(400, detail, headers={"Connection": "close"})
        if len(host) != 1 or len(host[0]) > _LONGEST or not self._known(host[0]):
            return _host_refused(host)
        if origin is not None and not self._may_use(origin, host[0]):
            return _origin_refused(origin)
        return _coding_refused(coding) if coding else None

    def _is_known(self, host: bytes) -> bool:
        found = _HOST.fullmatch(host.decode("latin-1"))
        if found is None:
            return False
        name = (found[1] or found[2]).lower()
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return found[2] is not None and any(_means(pattern, name) for pattern in self._hosts)
        return True

    def _may_use(self, origin: bytes, host: bytes) -> bool:
        named = origin.decode("latin-1").lower()
        own = named.partition("://")[2] == host.decode("latin-1").lower()
        return own or named in self._origins or "*" in self._origins


def _means(pattern: str, name: str) -> bool:
    return pattern in ("*", name) or (pattern.startswith("*.") and name.endswith(pattern[1:]))


def _host_refused(host: list[bytes]) -> Response:
    named = f"is {_shown(host[0])}" if len(host) == 1 else f"was sent {len(host)} times"
    other = "the server is not called so (RHYTID_ALLOWED_HOSTS has its names)"
    return problem(400, f"Host {named}: {other}")


def _origin_refused(origin: bytes) -> Response:
    other = "its web pages may not use this server (RHYTID_CORS_ORIGINS has those that may)"
    return problem(403, f"Origin is {_shown(origin)}: {other}")


def _coding_refused(coding: bytes) -> Response | None:
    if coding.strip().lower() in (b"", b"identity"):
        return None
    detail = f"Content-Encoding is {_shown(coding)}: send the body as it is"
    return problem(415, detail, headers={"Accept-Encoding": "identity"})


def _shown(value: bytes) -> str:
    return repr(value[:_LONGEST].decode("latin-1"))


def id_of(headers: Iterable[tuple[bytes, bytes]]) -> str:
    """Return the id that the client gave its request, where it is well formed and was sent once;
    else a new id of 32 hexadecimal digits."""
    given = [value for name, value in headers if name == _NAME]
    if len(given) == 1 and _FORM.fullmatch(given[0]):
        return given[0].decode("ascii")
    return secrets.token_hex(16)


class RequestIds:
    """ASGI middleware: gives every request its id, and every answer the header."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on."""
        if scope["type"] not in ("http", "websocket"):
            return self.app(scope, receive, send)
        found = id_of(scope["headers"])
        # It is not reset: the handler of unexpected failures, outside of this middleware, sends the
        # id, too. The server runs every request in a context of its own.
        request_id.set(found)
        header = (_NAME, found.encode("ascii"))

        async def named(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message = {**message, "headers": [*message.get("headers", ()), header]}
            await send(message)

        return self.app(scope, receive, named)
