"""What requests hold of memory and disk, and that it is given back however they end."""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from api.asking import NPY, built, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import positions, smile, upload
from rhytid.api import admission, encoding, request_memory
from rhytid.engine.byte_budget import ByteBudget, Hold

MIB = 1 << 20
HEAD = b'--b\r\nContent-Disposition: form-data; name="mesh"; filename="m.obj"\r\n\r\n'


class SmallEngine(FakeEngine):
    """Has 96 MiB for requests, and refuses soon who does not get any."""

    def __init__(self) -> None:
        super().__init__()
        self.memory = ByteBudget(96 * MIB, "RHYTID_HOST_MEMORY_MB", patience=0.05)


@pytest.fixture
def engine() -> SmallEngine:
    return SmallEngine()


@pytest.fixture
def client(engine: SmallEngine, tmp_path: Path) -> Iterator[httpx.Client]:
    (tmp_path / "partial").mkdir()
    with serving(engine, store=tmp_path, spool=64 * MIB) as client:
        yield client


def connected(client: httpx.Client) -> socket.socket:
    return socket.create_connection((client.base_url.host, client.base_url.port or 0))


def uploading(client: httpx.Client, sent: int, declared: int) -> socket.socket:
    """A connection on which so many bytes of an upload were sent."""
    connection = connected(client)
    head = (
        "POST /v1/assets HTTP/1.1\r\nHost: localhost\r\n"
        "Content-Type: multipart/form-data; boundary=b\r\n"
        f"Content-Length: {declared}\r\n\r\n"
    )
    connection.sendall(head.encode() + HEAD + bytes(sent))
    return connection


def soon(holds: Callable[[], bool]) -> None:
    """Fails where that is not so within ten seconds."""
    end = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def is_reset(connection: socket.socket) -> bool:
    """Whether the server has broken a connection."""
    try:
        connection.sendall(b" ")
    except ConnectionError:
        return True
    return False


def use(client: httpx.Client, budget: str) -> dict[str, Any]:
    found: dict[str, Any] = client.get("/v1/memory").raise_for_status().json()[budget]
    return found


def map_path(client: httpx.Client, resolution: int) -> str:
    asset = built(client, upload(resolution=resolution, tile_size=64))
    return f"/v1/assets/{asset}/frames/neutral/maps/1001"


def test_uploads_lie_on_disk_until_their_client_is_gone(
    client: httpx.Client, tmp_path: Path
) -> None:
    open_ones = [uploading(client, 12 * MIB, 100 * MIB) for _ in range(3)]
    soon(lambda: use(client, "spool")["used"] >= 33 * MIB)
    now = use(client, "spool")  # more bytes may come between two looks
    assert now["purposes"] == {"uploads": now["used"], "answers": 0}
    assert list((tmp_path / "partial").iterdir()) == []  # they have no names
    for connection in open_ones:
        connection.close()
    soon(lambda: use(client, "spool")["used"] == 0)


def test_purposes_sum_to_what_is_used(client: httpx.Client) -> None:
    asset = built(client, upload(resolution=256, tile_size=64))
    path = f"/v1/assets/{asset}/frames/neutral/tiles/1001/0/0/0"
    size = len(client.get(path, params={"format": "exr"}).content)

    soon(lambda: use(client, "small")["used"] == size)  # else the answer is being sent
    small = use(client, "small")
    assert small["purposes"] == {"answers": 0, "uploads": 0, "encoded": size}
    line = 'rhytid_bytes{budget="small",purpose="encoded"} '
    assert f"{line}{float(size)}\n" in client.get("/metrics").text


def test_uploads_beyond_the_room_on_disk_are_refused(client: httpx.Client) -> None:
    with uploading(client, 70 * MIB, 100 * MIB) as connection:
        answer = connection.recv(1 << 16)
    assert answer.startswith(b"HTTP/1.1 507 ")
    soon(lambda: use(client, "spool")["used"] == 0)


def test_an_upload_takes_its_share_of_memory_while_it_is_used(
    engine: SmallEngine, client: httpx.Client
) -> None:
    taken = engine.memory.hold("answers")
    taken.grow(96 * MIB - 100)
    response = client.post("/v1/assets", files=upload())
    assert "RHYTID_HOST_MEMORY_MB" in is_problem(response, 503, "host-busy")
    assert response.headers["retry-after"] == "5"
    taken.release()
    assert client.post("/v1/assets", files=upload()).status_code == 200
    soon(lambda: engine.memory.used == 0)


def test_small_requests_do_not_wait_for_large_ones(
    engine: SmallEngine, client: httpx.Client
) -> None:
    frame, large = f"/v1/assets/{built(client, upload())}/frames/smile", map_path(client, 2048)
    taken = engine.memory.hold("uploads")
    taken.grow(96 * MIB)
    assert client.put(frame, content=npy(smile()), headers=NPY).status_code == 200
    for path in (f"{frame}/tiles/1001/0/0/0", frame, f"{frame}/stretch"):
        assert client.get(path).status_code == 200, path
    is_problem(client.get(large), 503, "host-busy")
    soon(lambda: use(client, "small")["used"] == use(client, "small")["purposes"]["encoded"])
    assert use(client, "small")["limit"] == 24 * MIB
    taken.release()


def test_a_frame_takes_its_share_of_memory_while_it_arrives(
    engine: SmallEngine, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request_memory, "SMALL", 0)
    path = f"/v1/assets/{built(client, upload())}/frames/smile"
    taken = engine.memory.hold("answers")
    taken.grow(96 * MIB - 100)
    response = client.put(path, content=npy(smile()), headers=NPY)
    is_problem(response, 503, "host-busy")
    taken.release()
    assert client.put(path, content=npy(smile()), headers=NPY).status_code == 200
    soon(lambda: engine.memory.used == 0)


def test_an_answer_counts_until_it_is_read(client: httpx.Client) -> None:
    path = map_path(client, 2048)
    with connected(client) as reader:
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        head = f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        reader.sendall(head.encode())
        assert reader.recv(4) == b"HTTP"
        time.sleep(0.3)
        held = use(client, "host")["purposes"]["answers"]
        assert 16 * MIB <= held < 17 * MIB  # of the file alone, once it is encoded
        while reader.recv(1 << 20):
            pass
    soon(lambda: use(client, "host")["used"] == 0)


def test_a_large_answer_lies_on_disk_until_it_is_read(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = client.get(map_path(client, 2048)).content
    monkeypatch.setattr(encoding, "LARGE", 16 * MIB)
    path = map_path(client, 2048)
    with connected(client) as reader:
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        head = f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        reader.sendall(head.encode())
        assert reader.recv(4) == b"HTTP"
        soon(lambda: use(client, "spool")["purposes"]["answers"] == len(whole))
        assert use(client, "host")["used"] == 0
        found = b"".join(iter(partial(reader.recv, 1 << 20), b""))
    assert found.endswith(whole)
    assert f"content-length: {len(whole)}\r\n".encode() in found[:1000].lower()
    soon(lambda: use(client, "spool")["used"] == 0)


def test_huge_answers_are_made_two_at_a_time(
    engine: SmallEngine, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(admission, "HUGE", 1)
    monkeypatch.setattr(admission, "PATIENCE", 0.1)
    path = map_path(client, 1024)
    engine.memory.patience = 30
    taken = engine.memory.hold("jobs")
    taken.grow(96 * MIB)
    with ThreadPoolExecutor(2) as pool:
        others = [pool.submit(client.get, path) for _ in range(2)]
        soon(lambda: engine.memory.waiting == 2)
        assert "2 at a time" in is_problem(client.get(path), 503, "host-busy")
        taken.release()
        assert [other.result().status_code for other in others] == [200, 200]
    assert client.get(path).status_code == 200


def test_a_large_answer_stays_in_memory_where_the_disk_has_no_room(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "LARGE", 0)
    path = map_path(client, 2048)
    with uploading(client, 60 * MIB, 100 * MIB):
        soon(lambda: use(client, "spool")["used"] >= 57 * MIB)
        assert len(client.get(path).content) > 16 * MIB
        assert use(client, "spool")["used"] < 61 * MIB


def test_a_client_that_takes_nothing_is_dropped(engine: SmallEngine, tmp_path: Path) -> None:
    with (
        serving(engine, store=tmp_path, stall_seconds=1.0) as client,
        connected(client) as reader,
    ):
        path = map_path(client, 2048)
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        reader.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        assert reader.recv(4) == b"HTTP"
        soon(lambda: use(client, "host")["used"] == 0)
        soon(partial(is_reset, reader))  # though nothing of it was read


def test_answers_that_do_not_fit_beside_others_wait_and_are_refused(
    engine: SmallEngine, client: httpx.Client
) -> None:
    path = map_path(client, 2048)
    taken = engine.memory.hold("answers")
    taken.grow(80 * MIB)
    response = client.get(path)
    is_problem(response, 503, "host-busy")
    assert response.headers["retry-after"] == "5"
    engine.memory.patience = 30
    with ThreadPoolExecutor(1) as pool:
        later = pool.submit(client.get, path)
        soon(lambda: engine.memory.waiting == 1)
        taken.release()
        assert later.result().status_code == 200


def test_an_answer_that_never_fits_is_refused_with_its_size(client: httpx.Client) -> None:
    detail = is_problem(client.get(map_path(client, 4096)), 507, "host-memory")
    assert str(2 * 4 * 4096**2) in detail
    assert "RHYTID_HOST_MEMORY_MB" in detail


def test_a_large_answer_comes_whole(client: httpx.Client) -> None:
    response = client.get(map_path(client, 1024), params={"format": "f16"})
    assert len(response.content) == 2 * 1024**2
    assert int(response.headers["content-length"]) == len(response.content)


def test_the_metrics_have_the_budgets(engine: SmallEngine, client: httpx.Client) -> None:
    taken = engine.memory.hold("jobs")
    taken.grow(12345)
    lines = client.get("/metrics").text.splitlines()
    assert 'rhytid_bytes{budget="host",purpose="jobs"} 12345.0' in lines
    assert 'rhytid_bytes_limit{budget="host"} 1.00663296e+08' in lines
    assert 'rhytid_bytes_waiting{budget="spool"} 0.0' in lines
    taken.release()


@pytest.mark.parametrize("what", ["graph", "graph?format=obj", "mesh", "mesh?format=ply"])
def test_what_is_stored_is_not_read_for_who_has_it(
    engine: SmallEngine, client: httpx.Client, what: str
) -> None:
    asset = built(client, upload())
    path = f"/v1/assets/{asset}/{what}"
    first = client.get(path)
    tag = {"If-None-Match": first.headers["etag"]}
    assert first.headers["cache-control"] == "no-cache"
    for name in ("graph", "mesh", "curves"):
        setattr(engine.assets, name, None)
    again = client.get(path, headers=tag)
    assert (again.status_code, again.content) == (304, b"")
    client.patch(f"/v1/assets/{asset}", json={"depth": 0.25}).raise_for_status()
    with pytest.raises(AssertionError):
        assert client.get(path, headers=tag).status_code == 304


def test_kinds_of_what_is_stored_have_tags_of_their_own(client: httpx.Client) -> None:
    asset = built(client, upload())
    names = ("graph", "graph?format=obj", "graph?format=usda", "mesh", "mesh?format=ply")
    tags = {client.get(f"/v1/assets/{asset}/{name}").headers["etag"] for name in names}
    assert len(tags) == len(names)


def test_an_etag_of_a_body_is_that_of_its_bytes(client: httpx.Client) -> None:
    path = f"/v1/assets/{built(client, upload())}/bins/1001/0/0/0"
    tags = [client.get(path, params={"layer": "wrinkles", "bin": 0, "sample": s}) for s in (0, 1)]
    assert len({response.headers["etag"] for response in tags}) == 2
    assert all(np.frombuffer(response.content, np.uint8).size for response in tags)


def test_frames_that_come_with_a_mesh_fit_beside_their_upload(
    engine: SmallEngine, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An upload whose decoding may take all of the memory: its frames do not wait for itself."""
    frames = np.repeat(smile(0.1)[None], 30 * MIB // smile(0.1).nbytes, axis=0)
    create = engine.assets.create

    def holding(new: Any, hold: Hold, **options: Any) -> Any:
        """As the engine does, whose job holds the frames."""
        part = hold.split("jobs", new.frames.nbytes)
        assert part.nbytes == new.frames.nbytes
        part.release()
        return create(new, **options)

    monkeypatch.setattr(engine.assets, "create", holding)
    file = io.BytesIO()
    faces = np.array([[0, 1, 6], [0, 6, 5]], np.int32)
    uv = positions()[:, :2].astype(np.float64)
    np.savez(file, positions=positions(), faces=faces, uv=uv, face_uv=faces, frames=frames)
    assert 3 * len(file.getvalue()) + frames.nbytes > 96 * MIB

    answer = client.post("/v1/assets", files=upload(file.getvalue(), "patch.npz"))

    assert answer.status_code in (200, 202), answer.text
    soon(lambda: engine.memory.used == 0)
