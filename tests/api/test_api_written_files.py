"""Files that are kept on disk while ranges of them are asked for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from api.asking import built
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import upload
from rhytid.api.spool import Spool
from rhytid.api.written_files import WrittenFiles
from rhytid.engine import call_context
from rhytid.engine.byte_budget import ByteBudget
from rhytid.errors import BusyError, CancelledError, HostBusyError, StorageError

BODY = [b"01234", memoryview(b"56789")]
LIMIT = 100


@pytest.fixture
def budget() -> ByteBudget:
    return ByteBudget(LIMIT, "RHYTID_SPOOL_MB", patience=0.1)


@pytest.fixture
def files(budget: ByteBudget, tmp_path: Path) -> Iterator[WrittenFiles]:
    made = WrittenFiles(budget, tmp_path)
    yield made
    made.clear()
    assert budget.used_for("answers") == 0


class Counted:
    """Writes a file, and counts how often."""

    def __init__(self, body: Any = BODY) -> None:
        self.calls, self._body = 0, body

    def __call__(self) -> Any:
        self.calls += 1
        return self._body


def read(files: WrittenFiles, asked: range, write: Callable[[], Any]) -> bytes:
    file = files.opened("a", 10, write)
    assert file is not None
    with closing(file):
        return b"".join(file.within(asked, 2))


def graphs_of(engine: FakeEngine) -> list[str]:
    """The assets whose graphs are asked for from now on."""
    calls, graph = list[str](), engine.assets.graph

    def counted(asset: str) -> Any:
        calls.append(asset)
        return graph(asset)

    engine.assets.graph = counted  # type: ignore[method-assign]
    return calls


def until(met: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not met():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_ranges_of_a_file_cost_it_once(
    files: WrittenFiles, budget: ByteBudget, tmp_path: Path
) -> None:
    write = Counted()
    assert read(files, range(3, 8), write) == b"34567"
    assert read(files, range(10), write) == b"0123456789"
    assert (write.calls, budget.used_for("answers")) == (1, 10)
    assert [*tmp_path.iterdir()] == []
    files.clear()
    assert budget.used == 0
    assert read(files, range(2), write) == b"01"
    assert write.calls == 2


def test_who_asks_while_another_writes_waits_for_the_same(files: WrittenFiles) -> None:
    goes_on, write = threading.Event(), Counted()

    def slowly() -> Any:
        assert goes_on.wait(10)
        return write()

    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(read, files, range(10), slowly) for _ in range(4)]
        until(lambda: "a" in files._kept and files._kept["a"].users == 4)
        goes_on.set()
        assert {one.result() for one in asked} == {b"0123456789"}
    assert write.calls == 1


def test_a_file_goes_when_nobody_reads_it(budget: ByteBudget, tmp_path: Path) -> None:
    files = WrittenFiles(budget, tmp_path, seconds=0.02)
    file = files.opened("a", 10, Counted())
    assert file is not None
    time.sleep(0.1)
    files.clear()
    assert b"".join(file.within(range(10), 10)) == b"0123456789"
    file.close()
    until(lambda: budget.used == 0)


def test_a_file_leaves_the_disk_to_who_waits_for_it(
    files: WrittenFiles, budget: ByteBudget
) -> None:
    read(files, range(10), Counted())
    budget.hold("uploads").grow(LIMIT)
    assert budget.used == LIMIT


@pytest.mark.parametrize("reason", ["room", "share", "changed", "larger"])
def test_what_cannot_be_kept_is_told(files: WrittenFiles, budget: ByteBudget, reason: str) -> None:
    """The disk is full, the file is too large for its share, or what it has was changed."""
    if reason == "room":
        budget.hold("uploads").grow(LIMIT - 5)
    body = {"changed": None, "larger": [bytes(2 * LIMIT)]}.get(reason, BODY)
    assert files.opened("a", LIMIT if reason == "share" else 10, Counted(body)) is None
    assert files._kept == {}


def test_an_error_of_writing_keeps_nothing(files: WrittenFiles) -> None:
    def fail() -> Any:
        raise BusyError("not now")

    with pytest.raises(BusyError):
        files.opened("a", 10, fail)
    write = Counted()
    assert read(files, range(1), write) == b"0"
    assert write.calls == 1


def test_a_download_in_ranges_asks_for_the_graph_once(tmp_path: Path) -> None:
    """By several clients at a time; a change of settings makes it another file."""
    engine = FakeEngine(polls=1)
    with serving(engine, store=tmp_path) as client:
        path = f"/v1/assets/{(asset := built(client, upload()))}/graph"
        whole, calls = client.get(path).content, graphs_of(engine)

        def part(at: int) -> bytes:
            answer = client.get(path, headers={"Range": f"bytes={at}-{at + 49}"})
            assert answer.status_code == 206
            return answer.content

        with ThreadPoolExecutor(4) as pool:
            assert b"".join(pool.map(part, range(0, len(whole), 50))) == whole
        assert len(calls) == 1
        client.patch(f"/v1/assets/{asset}", json={"depth": 0.125}).raise_for_status()
        part(0)
        assert len(calls) == 2
        assert client.get(path, headers={"Range": "bytes=99999999-"}).status_code == 416


def test_a_range_of_what_is_changed_meanwhile_is_all_of_what_there_is_now(tmp_path: Path) -> None:
    engine = FakeEngine(polls=1)
    graph = engine.assets.graph

    def changed(asset: str) -> Any:
        engine.assets.change(asset, {"depth": 0.125})
        return graph(asset)

    with serving(engine, store=tmp_path) as client:
        path = f"/v1/assets/{built(client, upload())}/graph"
        engine.assets.graph = changed  # type: ignore[method-assign]
        answer = client.get(path, headers={"Range": "bytes=0-49"})
        assert (answer.status_code, answer.headers["Cache-Control"]) == (200, "no-store")
        assert len(answer.content) == int(answer.headers["Content-Length"]) > 50
        assert client.get(path, headers={"Range": "bytes=0-49"}).status_code == 206


def test_a_range_is_sent_where_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The graph is asked for once for each."""

    def full(spool: Spool, data: bytes) -> None:
        raise StorageError("the disk is full")

    engine = FakeEngine(polls=1)
    with serving(engine, store=tmp_path) as client:
        path = f"/v1/assets/{built(client, upload())}/graph"
        whole, calls = client.get(path).content, graphs_of(engine)
        monkeypatch.setattr(Spool, "fill", full)
        for _ in range(2):
            answer = client.get(path, headers={"Range": "bytes=7-49"})
            assert (answer.status_code, answer.content) == (206, whole[7:50])
        assert len(calls) == 2


def test_who_waits_for_another_writer_stops_when_the_client_is_gone(files: WrittenFiles) -> None:
    goes_on, begun = threading.Event(), threading.Event()

    def slowly() -> Any:
        begun.set()
        assert goes_on.wait(10)
        return BODY

    def waits() -> Any:
        with call_context.abandoned_when(lambda: True):
            return read(files, range(10), Counted())

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(read, files, range(10), slowly)
        assert begun.wait(10)
        second = pool.submit(waits)
        with pytest.raises(CancelledError):
            second.result(5)
        goes_on.set()
        assert first.result() == b"0123456789"


def test_who_waits_for_another_writer_waits_so_long_at_most(
    files: WrittenFiles, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.api.admission.PATIENCE", 0.2)
    goes_on = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(read, files, range(10), lambda: goes_on.wait(10) and BODY)
        until(lambda: "a" in files._kept and files._kept["a"].writing.locked())
        with pytest.raises(HostBusyError, match=r"another request wrote this file for 0\.2 s"):
            read(files, range(10), Counted())
        goes_on.set()
        assert first.result() == b"0123456789"
