"""One server for the tests of live connections, over an engine that can be held."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest

from api.asking import built
from api.live import serving
from api.patch import upload
from live.gated import GatedEngine, packed
from live.speaker import Speaker, speaking


@pytest.fixture(scope="session")
def engine() -> GatedEngine:
    return GatedEngine()


@pytest.fixture(scope="session")
def server(engine: GatedEngine) -> Iterator[httpx.Client]:
    with serving(engine) as client:
        yield client


@pytest.fixture(scope="session")
def asset(server: httpx.Client) -> str:
    return built(server, {**upload(), "shapes": ("shapes.npz", packed())})


@pytest.fixture(scope="session")
def plain(server: httpx.Client) -> str:
    """An asset without shapes."""
    return built(server, upload(depth=0.125))


@pytest.fixture
def speaker(engine: GatedEngine, server: httpx.Client, asset: str) -> Iterator[Speaker]:
    with speaking(server, asset) as found:
        yield found
    engine.gate.set()
