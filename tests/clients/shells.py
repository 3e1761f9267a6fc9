"""Both clients behind one blocking face, so that one test speaks for the two."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from rhytid_client import AsyncClient, Client

URL = "http://rhytid.test/api/"
Handler = Callable[[httpx.Request], httpx.Response]


class Shell:
    """`shell.name(...)` calls the method `name` of a client over `handler` and waits for it."""

    def __init__(self, kind: str, handler: Handler, **options: Any) -> None:
        transport = httpx.MockTransport(handler)
        self._client: Client | AsyncClient
        if kind == "sync":
            self._client = Client(URL, http=httpx.Client(transport=transport), **options)
        else:
            self._client = AsyncClient(URL, http=httpx.AsyncClient(transport=transport), **options)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method = getattr(self._client, name)
        if isinstance(self._client, Client):
            return method  # type: ignore[no-any-return]

        def waited(*args: Any, **kwargs: Any) -> Any:
            return asyncio.run(method(*args, **kwargs))

        return waited


class Script:
    """Answers requests one after the other, the last answer for ever; keeps what was sent."""

    def __init__(self, *answers: httpx.Response | Exception) -> None:
        self._answers = list(answers)
        self.seen: list[httpx.Request] = []
        self.bodies: list[bytes] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.seen.append(request)
        self.bodies.append(request.content)
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        if isinstance(answer, Exception):
            raise answer
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)


def problem(status: int, kind: str = "", **headers: str) -> httpx.Response:
    """A refusal with problem details; an underscore in the name of a header is a dash."""
    body = {"type": f"urn:{kind}", "title": "No", "status": status, "detail": "because"}
    body["request_id"] = "shot-7"
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return httpx.Response(status, json=body, headers=named)


class Clock:
    """A clock that only the clients' own pauses move; `pauses` lists them."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.pauses: list[float] = []
        patch.setattr("rhytid_client.calls.job_calls.monotonic", lambda: self.now)
        patch.setattr("rhytid_client.blocking.sleep", self.sleep)
        patch.setattr("rhytid_client.async_client.sleep", self.awaited_sleep)

    def sleep(self, seconds: float) -> None:
        self.pauses.append(seconds)
        self.now += seconds

    async def awaited_sleep(self, seconds: float) -> None:
        self.sleep(seconds)
