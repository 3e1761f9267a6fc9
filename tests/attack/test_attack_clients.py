"""Clients that stall and vanish, and bombs: what a server holds afterwards."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from api.asking import built
from api.patch import upload
from attack.bombs import BOMBS, MIB
from attack.clients import connected, is_open, not_reading, sending
from attack.served import Attacked, Peak, await_value, resident, serving

pytestmark = pytest.mark.attack
STALL = 3
# What an upload may take is told by its bytes and its headers; none of BOMBS may take more.
CEILING = 3200 * MIB
# What may stay: one answer of 64 MiB is more.
LEFT = 50 * MIB


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Attacked]:
    folder = tmp_path_factory.mktemp("attacked")
    with serving(folder, RHYTID_STALL_SECONDS=str(STALL), RHYTID_CONNECTIONS="400") as running:
        yield running


@pytest.fixture(scope="module")
def asset(server: Attacked) -> str:
    return built(server.client, upload(resolution=4096, tile_size=512))


def held(server: Attacked) -> int:
    """Bytes of all budgets that requests hold."""
    found = server.client.get("/v1/memory").raise_for_status().json()
    return sum(budget["used"] for budget in found.values())


def files(server: Attacked) -> int:
    """Descriptors of the server itself."""
    return len(list(Path(f"/proc/{server.process.pid}/fd").iterdir()))


def nothing_left(server: Attacked, before: int) -> bool:
    return held(server) == 0 and files(server) <= before + 8


def test_connections_that_send_a_letter_are_closed(server: Attacked) -> None:
    before = files(server)
    with ExitStack() as closing:
        letters = [closing.enter_context(connected(server)) for _ in range(250)]
        for one in letters:  # of which 200 are let in
            with suppress(OSError):
                one.sendall(b"G")
        await_value(lambda: files(server) <= before + 8)
        assert not any(is_open(one) for one in letters)
    assert server.client.get("/healthz").status_code == 200


def test_uploads_that_stop_are_given_back(server: Attacked) -> None:
    before = files(server)
    with ExitStack() as closing:
        every = [closing.enter_context(sending(server, 24 * MIB, 100 * MIB)) for _ in range(8)]
        await_value(lambda: nothing_left(server, before))
        assert not any(is_open(one) for one in every)


def test_who_does_not_read_holds_no_memory(server: Attacked, asset: str) -> None:
    path = f"/v1/assets/{asset}/frames/neutral/maps/1001"
    server.client.get(path).raise_for_status()
    before = files(server)
    at_rest = resident(server.process.pid)
    with ExitStack() as closing:
        for _ in range(12):
            closing.enter_context(not_reading(server, path))
        time.sleep(1)
        await_value(lambda: nothing_left(server, before))
    # Of the server: allocators of the process of the device keep what they had once.
    assert resident(server.process.pid) - at_rest < LEFT
    assert server.client.get(path).status_code == 200


def test_who_vanishes_leaves_nothing(server: Attacked, asset: str) -> None:
    before = files(server)
    paths = [
        f"/v1/assets/{asset}/frames/neutral/{place}?method={method}"
        for place in ("maps/1001", "tiles/1001/0/3/3")
        for method in ("redraw", "binned", "convolved")
    ]
    for number in range(60):
        if number % 2:
            one = not_reading(server, paths[number % len(paths)])
        else:
            one = sending(server, MIB * (number % 5), 50 * MIB)
        time.sleep(0.01 * (number % 7))
        one.close()
    await_value(lambda: nothing_left(server, before))
    assert server.client.get(paths[0]).status_code == 200


def test_decoding_ends_with_its_client(server: Attacked) -> None:
    before = len(server.tree())
    request = server.client.build_request(
        "POST", "/v1/assets", files=BOMBS["obj: 64 MiB of vertices"]()
    )
    head = "".join(f"{name}: {value}\r\n" for name, value in request.headers.items())
    with connected(server) as sender:
        sender.sendall(f"POST /v1/assets HTTP/1.1\r\n{head}\r\n".encode() + request.read())
        await_value(lambda: len(server.tree()) > before)
    await_value(lambda: len(server.tree()) == before and held(server) == 0)


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_takes_no_more_than_it_may(server: Attacked, name: str) -> None:
    files = BOMBS[name]()
    with Peak(server) as peak:
        response = server.client.post("/v1/assets", files=files, timeout=300)
        if response.status_code == 202:
            path = f"/v1/assets/{response.json()['id']}"
            server.client.delete(path)
            await_value(lambda: server.client.get(path).status_code == 404)
        await_value(lambda: held(server) == 0)
    assert response.status_code in (202, 413, 422, 507), response.text
    if response.status_code != 202:
        assert response.headers["content-type"] == "application/problem+json"
        assert response.json()["detail"]
    assert peak.more < CEILING
    assert server.client.get("/readyz").status_code == 200
