"""A device with work for a long time: who waits, who is sent away, and who is answered anyway."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, is_problem, npy
from api.fake_engine import FakeEngine
from api.fake_tiles import FakeTiles
from api.live import serving
from api.patch import smile, upload
from rhytid.api.admission import DeviceSlots
from rhytid.errors import BusyError

PLACES = 64
TILE = "tiles/1001/0/0/0"


class SlowEngine(FakeEngine):
    """Draws nothing until `go`; `came` counts the requests that wait."""

    def __init__(self) -> None:
        super().__init__()
        self.came = threading.Semaphore(0)
        self.go = threading.Event()
        self.tiles = SlowTiles(self.state, self)


@dataclass
class SlowTiles(FakeTiles):
    """Tiles that wait for `engine.go`."""

    engine: SlowEngine

    def tile(self, *arguments: Any) -> Any:
        self.engine.came.release()
        assert self.engine.go.wait(60)
        return super().tile(*arguments)


class Crowded:
    """A server whose places are all taken, and the requests that took them."""

    def __init__(self, client: httpx.Client, engine: SlowEngine, pool: ThreadPoolExecutor) -> None:
        self.client, self.engine = client, engine
        self.asset = f"/v1/assets/{built(client, upload())}"
        self.job = client.get(self.asset).json()["job"]
        self.tag = client.head(f"{self.asset}/frames/neutral/{TILE}").headers["etag"]
        path = str(client.base_url.join(f"{self.asset}/frames/neutral/{TILE}"))
        self.waiting: list[Future[httpx.Response]] = [
            pool.submit(httpx.get, path, timeout=60) for _ in range(PLACES)
        ]
        for _ in range(PLACES):
            assert engine.came.acquire(timeout=20), "not all of them wait for the device"


@pytest.fixture(scope="module")
def crowded() -> Iterator[Crowded]:
    engine = SlowEngine()
    with serving(engine, queue=PLACES) as client, ThreadPoolExecutor(PLACES) as pool:
        try:
            yield Crowded(client, engine, pool)
        finally:
            engine.go.set()


@pytest.mark.parametrize(
    "path",
    ["/v1/assets", "/v1/devices", "{asset}", "{asset}/frames", "{job}", "/readyz", "/healthz"],
)
def test_what_needs_no_device_is_answered_meanwhile(crowded: Crowded, path: str) -> None:
    path = path.format(asset=crowded.asset, job=f"/v1/jobs/{crowded.job}")
    assert crowded.client.get(path, timeout=20).status_code == 200


def test_a_tile_that_has_not_changed_needs_no_place(crowded: Crowded) -> None:
    path = f"{crowded.asset}/frames/neutral/{TILE}"
    known = crowded.client.get(path, headers={"If-None-Match": crowded.tag}, timeout=20)
    assert known.status_code == 304


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("GET", "{asset}/frames/neutral/tiles/1001/0/0/0", None),
        ("GET", "{asset}/frames/neutral/maps/1001", None),
        ("GET", "{asset}/frames/neutral/stretch", None),
        ("GET", "{asset}/bins", None),
        ("GET", "{asset}/bins/1001/0/0/0?layer=wrinkles&bin=0&sample=0", None),
        ("PUT", "{asset}/frames/smile", npy(smile())),
        ("POST", "{asset}/tiles?tile=1001/0/0/0", npy(smile())),
        ("PATCH", "{asset}", b'{"depth": 0.1}'),
    ],
)
def test_one_more_for_the_device_is_sent_away_at_once(
    crowded: Crowded, method: str, path: str, body: bytes | None
) -> None:
    headers = {"Content-Type": "application/json"} if method == "PATCH" else NPY
    path = path.format(asset=crowded.asset)
    answer = crowded.client.request(method, path, content=body, headers=headers, timeout=20)
    assert str(PLACES) in is_problem(answer, 503, "busy")
    assert answer.headers["retry-after"] == "1"


def test_positions_take_a_place(crowded: Crowded) -> None:
    path = f"{crowded.asset}/frames/neutral"
    answer = crowded.client.get(path, headers={"Accept": "application/x-npy"}, timeout=20)
    assert str(PLACES) in is_problem(answer, 503, "busy")
    assert crowded.client.get(path, timeout=20).status_code == 200


@pytest.mark.slow
def test_all_that_waited_are_answered_and_their_places_are_free_again() -> None:
    engine = SlowEngine()
    with serving(engine, queue=PLACES) as client, ThreadPoolExecutor(PLACES) as pool:
        try:
            crowded = Crowded(client, engine, pool)
        finally:
            engine.go.set()
        assert {answer.result(60).status_code for answer in crowded.waiting} == {200}
        assert client.get("/readyz").status_code == 200


def test_a_place_is_given_back_after_a_failure() -> None:
    places = DeviceSlots(1)
    with pytest.raises(ZeroDivisionError), places.one():
        raise ZeroDivisionError
    with (
        places.one(),
        pytest.raises(BusyError, match=r"^1 request waits for"),
        places.one(),
    ):
        pytest.fail("there is no second place")
