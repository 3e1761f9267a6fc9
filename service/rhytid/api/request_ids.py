"""The id of a request: its client's, or a new one; in the log, in problems and in the answer."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid.support.logs import request_id

HEADER = "X-Request-Id"
_NAME = HEADER.lower().encode()
# What may stand in a header, in a log and in a label without being quoted.
_FORM = re.compile(rb"[A-Za-z0-9._~+/=:-]{1,128}")


def id_of(headers: Iterable[tuple[bytes, bytes]]) -> str:
    """What the client calls its request, where that is well formed and sent once; else a new id of
    32 hexadecimal digits."""
    given = [value for name, value in headers if name == _NAME]
    if len(given) == 1 and _FORM.fullmatch(given[0]):
        return given[0].decode("ascii")
    return secrets.token_hex(16)


class RequestIds:
    """ASGI middleware: gives every request its id, and every answer the header."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        found = id_of(scope["headers"])
        # It is not taken back: what answers a failure, outside of this, tells it, too. The server
        # runs every request in a context of its own.
        request_id.set(found)
        header = (_NAME, found.encode("ascii"))

        async def named(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message = {**message, "headers": [*message.get("headers", ()), header]}
            await send(message)

        await self.app(scope, receive, named)
