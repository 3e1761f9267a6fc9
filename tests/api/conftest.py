"""One server for all tests of the transport that need no special engine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload


@pytest.fixture(scope="session")
def engine() -> Any:
    return FakeEngine()


@pytest.fixture(scope="session")
def server(engine: Any) -> Iterator[httpx.Client]:
    with serving(engine, upload_limit=1 << 20) as client:
        yield client


@pytest.fixture
def client(server: httpx.Client) -> Iterator[httpx.Client]:
    """A client of the server, which still answers after the test."""
    yield server
    assert server.get("/healthz").json() == {"status": "alive"}


@pytest.fixture(scope="session")
def asset(server: httpx.Client) -> str:
    return built(server, upload())


@pytest.fixture
def frame(server: httpx.Client, asset: str) -> Iterator[str]:
    """The path of a stored frame, forgotten after the test."""
    path = f"/v1/assets/{asset}/frames/smile"
    server.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    yield path
    server.delete(path)
