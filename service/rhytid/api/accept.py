"""Content negotiation by the header `Accept` (RFC 9110, section 12.5.1)."""

from __future__ import annotations

import re
from collections.abc import Awaitable
from dataclasses import dataclass

from fastapi import Request
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

# Bytes of any kind.
OCTETS = "application/octet-stream"
# Media types that are no files: texts, JSON documents, multipart bodies.
_OTHERS = ("text/", "multipart/", "application/json", "application/problem+json")
_WEIGHT = re.compile(r"0(\.[0-9]{0,3})?|1(\.0{0,3})?", re.ASCII)


@dataclass(frozen=True)
class _Range:
    """One entry of the header: a media type or a range such as `text/*`, its weight, and its
    position in the header."""

    name: str
    weight: float
    place: int

    def fits(self, offer: str) -> bool:
        """Whether the entry covers this media type."""
        return self.name in (offer, "*/*", offer.partition("/")[0] + "/*")

    @property
    def precision(self) -> tuple[bool, bool]:
        """How precise the entry is: a type overrides `type/*`, and that overrides `*/*`."""
        return self.name != "*/*", not self.name.endswith("/*")


def preferred(request: Request, offers: tuple[str, ...]) -> str:
    """Return the offer that the client prefers: the one of the highest weight; of equal weights the
    one that the client names first, then the one that is offered first.

    Raises HTTPException, a 406, where no offer has a weight above 0. An entry whose weight cannot
    be read is ignored; other parameters are not compared.
    """
    accept = ", ".join(request.headers.getlist("accept"))
    ranges = _ranges(accept or "*/*")
    rated = [(_rated(offer, ranges), offer) for offer in offers]
    (weight, _), best = max(rated, key=lambda pair: pair[0])
    if weight == 0.0:
        raise HTTPException(406, f"Accept is {accept!r}: one of {', '.join(offers)}")
    return best


def _ranges(accept: str) -> list[_Range]:
    found = []
    for place, entry in enumerate(accept.split(",")):
        name, *parameters = (piece.strip().lower() for piece in entry.split(";"))
        weights = [p[2:] for p in parameters if p.startswith("q=")] or ["1"]
        if _WEIGHT.fullmatch(weights[0]):
            found.append(_Range(name, float(weights[0]), place))
    return found


def _rated(offer: str, ranges: list[_Range]) -> tuple[float, int]:
    """Return the weight of an offer by the most precise entry that fits, and minus the position of
    that entry."""
    fitting = [entry for entry in ranges if entry.fits(offer)]
    if not fitting:
        return 0.0, 0
    entry = max(fitting, key=lambda entry: entry.precision)
    return entry.weight, -entry.place


class PlainBytes:
    """ASGI middleware: labels a file `application/octet-stream` where the client accepts that and
    not the type of the file. The bytes are the same."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        """Pass the request on; change the Content-Type of its answer where it must be."""
        accept = ", ".join(Headers(scope=scope).getlist("accept")) if "headers" in scope else ""
        if scope["type"] != "http" or OCTETS not in accept.lower():
            return self.app(scope, receive, send)
        ranges = _ranges(accept)

        async def renamed(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] < 300:
                _rename(MutableHeaders(scope=message), ranges)
            await send(message)

        return self.app(scope, receive, renamed)


def _rename(headers: MutableHeaders, ranges: list[_Range]) -> None:
    own = headers.get("content-type", "text/").lower()
    if not own.startswith(_OTHERS) and not _rated(own, ranges)[0] and _rated(OCTETS, ranges)[0]:
        headers["Content-Type"] = OCTETS
        headers.add_vary_header("Accept")
