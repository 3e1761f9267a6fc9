"""Keys of the clients: sent with every request, streams too, to the server alone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import obj
from clients.shells import Script, Shell
from rhytid.api.keys import new_key, write_keys
from rhytid_client import AsyncClient, Client, Job, NotAllowed, PlainClient

KEY = "rhytid_0123abcd_secret"


@pytest.mark.parametrize("given", [KEY, f"{KEY}\n"])
def test_a_key_is_sent_with_a_request(shell: Callable[..., Shell], given: str) -> None:
    script = Script(httpx.Response(200, json=[]))
    shell(script, key=given).devices()
    assert script.seen[0].headers["authorization"] == f"Bearer {KEY}"


@pytest.mark.parametrize("given", [None, ""])
def test_without_one_nothing_is_sent(shell: Callable[..., Shell], given: str | None) -> None:
    script = Script(httpx.Response(200, json=[]))
    shell(script, key=given).devices()
    assert "authorization" not in script.seen[0].headers


def test_a_key_does_not_follow_a_redirection(shell: Callable[..., Shell]) -> None:
    away = httpx.Response(302, headers={"Location": "http://elsewhere.test/"})
    script = Script(away)
    with pytest.raises(Exception, match="302"):
        shell(script, key=KEY).devices()
    assert len(script.seen) == 1


class Keyed(NamedTuple):
    url: str
    key: str
    reads: str


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Keyed]:
    """A server with a key that may send, and one that may only read."""
    file = tmp_path_factory.mktemp("keys") / "keys.json"
    (key, sends), (reads, asks) = new_key("a", ("read", "compute")), new_key("b", ("read",))
    write_keys(file, [sends, asks])
    with serving(FakeEngine(polls=3), keys=file) as client:
        yield Keyed(str(client.base_url), key, reads)


MESH = Path("patch.obj")


@pytest.mark.parametrize("kind", [Client, PlainClient])
def test_a_build_is_sent_and_waited_for_with_a_key(kind: Any, keyed: Keyed, tmp_path: Path) -> None:
    (tmp_path / MESH).write_bytes(obj())
    with ExitStack() as opened:

        def client(key: str | None = None) -> Any:
            made = kind(keyed.url, key=key)
            if kind is Client:
                opened.callback(made.close)
            return made

        sends, reads, nobody = client(keyed.key), client(keyed.reads), client()
        made = sends.create_asset(tmp_path / MESH, settings={"resolution": 256, "tile_size": 64})
        asset = sends.wait(made)
        assert asset.state == "ready"
        assert reads.tile(asset, "neutral", 1001, 0, 0, 0).array.any()
        with pytest.raises(NotAllowed, match=r"403 .* needs a key with the scope admin"):
            sends.delete_asset(asset)
        with pytest.raises(NotAllowed, match=r"401 .* API key is needed"):
            nobody.assets()
        assert nobody.health()


def test_the_same_awaited(keyed: Keyed, tmp_path: Path) -> None:
    (tmp_path / MESH).write_bytes(obj(2.0))

    async def session() -> None:
        async with AsyncClient(keyed.url, key=keyed.key) as client:
            settings = {"resolution": 256, "tile_size": 64}
            made = await client.create_asset(tmp_path / MESH, settings=settings)
            assert (await client.wait(made)).state == "ready"
            with pytest.raises(NotAllowed, match="403"):
                await client.delete_asset(made)
        async with AsyncClient(keyed.url) as nobody:
            with pytest.raises(NotAllowed, match="401"):
                await nobody.assets()

    asyncio.run(session())


def test_events_are_listened_to_with_the_key(shell: Callable[..., Shell]) -> None:
    """The stream of events is asked for in another way than calls are."""
    seen: list[httpx.Request] = []
    waited = Job("j", "a", "build", "running", 0.0, "", "")

    def handler(request: httpx.Request) -> httpx.Response:
        seen.append(request)
        state = "running" if len(seen) == 1 else "done"
        return httpx.Response(200, json=asdict(replace(waited, state=state)))

    assert shell(handler, key=KEY).wait(waited).state == "done"
    assert any(request.url.path.endswith("/events") for request in seen)
    assert {request.headers.get("authorization") for request in seen} == {f"Bearer {KEY}"}
