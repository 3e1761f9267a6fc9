"""What access costs a request: `PYTHONPATH=tests python tests/api/cost_of_access.py`.

Processor time of one answer (304 of a map) in this process, without a socket: with the checks
taken out, without keys, and with a key of a file of 101. The three take turns.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from unittest import mock

import fastapi
import httpx

from api.fake_engine import FakeEngine
from api.patch import upload
from rhytid.api import app as module
from rhytid.api.keys import new_key, write_keys
from rhytid.support.settings import ServiceSettings

ROUNDS, BEFORE = 3000, 300
HOST = "127.0.0.1:8717"
Ask = Callable[[], Awaitable[None]]


class PassOn:
    """In place of the check of heads."""

    def __init__(self, app: Any, **named: Any) -> None:
        self.app = app

    async def __call__(self, *args: Any) -> None:
        await self.app(*args)


def unguarded(**named: Any) -> fastapi.FastAPI:
    return fastapi.FastAPI(**{**named, "dependencies": []})


def apps(file: Path) -> dict[str, Any]:
    """One app without checks, one without keys, one with."""
    engine: Any = FakeEngine()
    without = ServiceSettings(ask_keys=False, key_rate=10**6)
    checked = module.create_app(engine, without)
    keyed = module.create_app(engine, ServiceSettings(keys=file))
    with mock.patch.multiple(module, FastAPI=unguarded, CheckHead=PassOn):
        bare = module.create_app(engine, without)
    return {"without checks": bare, "without keys": checked, "with a key": keyed}


async def made(app: Any) -> str:
    """The path of a map of a new asset of the engine that the apps share."""
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
        asset = (await client.post("/v1/assets", files=upload())).json()["id"]
    return f"/v1/assets/{asset}/frames/neutral/maps/1001"


async def asking(app: Any, path: str, key: str) -> Ask:
    """Asks for a map that the caller has already."""
    headers = {"Host": HOST, "Authorization": f"Bearer {key}"}
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as client:
        headers["If-None-Match"] = (await client.get(path, headers=headers)).headers["etag"]
    scope = {"type": "http", "method": "GET", "path": path, "query_string": b"",
             "client": ("127.0.0.1", 5), "http_version": "1.1", "scheme": "http",
             "headers": [(n.lower().encode(), v.encode()) for n, v in headers.items()]}  # fmt: skip

    async def receive() -> Any:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        assert message.get("status", 304) == 304

    return lambda: app({**scope, "state": {}}, receive, send)


async def main() -> None:
    """Measure and print."""
    keys = [new_key(f"key-{i}", {"read"}, rate=10**6) for i in range(101)]
    with tempfile.TemporaryDirectory() as folder:
        write_keys(file := Path(folder) / "keys.json", [kept for _, kept in keys])
        found = apps(file)
        path = await made(found["without keys"])
        asks: dict[str, Ask] = {}
        for name, app in found.items():
            async with app.router.lifespan_context(app):
                asks[name] = await asking(app, path, keys[50][0])
        times: dict[str, list[int]] = {name: [] for name in asks}
        for number in range(ROUNDS):
            for name in list(asks)[:: 1 if number % 2 else -1]:
                start = time.process_time_ns()
                await asks[name]()
                times[name].append(time.process_time_ns() - start)
    for name, took in times.items():
        median = statistics.median(took[BEFORE:]) / 1000
        sys.stdout.write(f"{name}: {median:.0f} µs at the median of {ROUNDS - BEFORE}\n")


if __name__ == "__main__":
    asyncio.run(main())
