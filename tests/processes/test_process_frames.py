"""Frames are what was stored last, however puts, deletions and ends of processes interleave."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from engine.engines import built, new_asset, running
from rhytid.domain.tiles import TileAddress
from rhytid.engine import call_context
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.frames import Frame
from rhytid.engine.messages import AssetInfo, FrameInfo, MapQuery, NewAsset
from rhytid.engine.operations import OPERATIONS, Proxy
from rhytid.errors import DeviceLostError, NotFoundError
from rhytid.processes.envelope import Request
from rhytid.processes.frame_ledger import FrameLedger
from rhytid.processes.job_ledger import JobLedger
from rhytid.processes.keyed_locks import KeyedLocks
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds

SECONDS = 60.0
VERTICES = 1000
WHOLE = TileAddress(1001, 0, 0, 0)
ASSET = AssetInfo("a", "ready", None, None, {}, (), 1, VERTICES, 1, 0, 0)


def frame(value: float) -> np.ndarray[Any, Any]:
    return np.full((VERTICES, 3), value, np.float32)


class Ended(Exception):
    """The process ended before it answered."""


class Process:
    """What a process of the device has: frames by name; each put of one that was sent."""

    def __init__(self) -> None:
        self.frames: dict[str, float] = {}
        self.puts: list[float] = []

    def perform(self, request: Request) -> Any:
        name, (_, *rest) = request.operation.name, request.positional
        if name == "frames.put":
            self.puts.append(float(rest[1][0, 0]))
            self.frames[rest[0]] = self.puts[-1]
            return FrameInfo(rest[0], {}, ())
        if name == "frames.delete":
            if rest[0] not in self.frames:
                raise NotFoundError(rest[0])
            return self.frames.pop(rest[0])
        if name == "frames.all":
            return sorted(self.frames)
        if name == "assets.delete":
            return self.frames.clear()
        if name == "assets.create":
            self.frames.update({"0001": 1.0})
            return ASSET
        if rest[0] not in self.frames:
            raise NotFoundError(rest[0])
        return self.frames[rest[0]]


class Caller:
    """What `Supervisors` is, with processes that end when a test says so.

    at: by the name of a call, what happens in the next process that gets it, before it performs it;
    after it, with `answering`.
    """

    def __init__(self) -> None:
        self.process = Process()
        self.at: dict[str, Callable[[], None]] = {}
        self.answering: dict[str, Callable[[], None]] = {}
        self.sent: list[Request] = []

    def restart(self) -> None:
        self.process = Process()

    def call(self, request: Request, prepare: Any = None) -> Any:
        while True:
            process = self.process
            try:
                if prepare is not None:
                    prepare(process)
                return self.ask(process, request)
            except Ended:
                continue

    def ask(self, process: Process, request: Request) -> Any:
        request.sent += 1
        self.sent.append(request)
        if request.packed.arrays:
            request.packed.write(np.empty(request.packed.nbytes, np.uint8))
        self.at.pop(request.operation.name, lambda: None)()
        if process is not self.process:
            raise Ended
        answer = process.perform(request)
        self.answering.pop(request.operation.name, lambda: None)()
        if process is not self.process:
            raise Ended
        return answer

    def forget(self, asset: str) -> None: ...


class Server:
    """The parts of a server that frames go through."""

    def __init__(self) -> None:
        self.caller = Caller()
        self.ledger = FrameLedger(1 << 30, self._put)
        uploads = UploadHolds(ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB"))
        calls = RemoteCalls(cast(Any, self.caller), self.ledger, JobLedger(), uploads)
        engine = Proxy(calls)
        self.frames, self.tiles, self.assets = engine.frames, engine.tiles, engine.assets

    def _put(self, process: Any, asset: str, name: str, positions: Any) -> None:
        with call_context.never_abandoned():
            self.caller.ask(process, Request(OPERATIONS["frames.put"], (asset, name, positions)))

    def drawn(self) -> float:
        """Of which positions a tile is drawn."""
        return cast(float, self.tiles.draw("a", "smile", MapQuery(), WHOLE))

    def create(self) -> None:
        new = cast(Any, _Upload(frame(1.0)[None]))
        self.assets.create(new)


class _Upload(NewAsset):
    def __init__(self, frames: Any) -> None:
        object.__setattr__(self, "frames", frames)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Upload, (self.frames,)


@pytest.fixture
def server() -> Server:
    made = Server()
    made.frames.put("a", "smile", frame(1.0))
    return made


@contextmanager
def threads() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(4) as pool:
        yield pool


def await_waiting(locks: KeyedLocks, users: int) -> None:
    """Until so many threads hold a lock of the ledger, or wait for it."""
    pause = threading.Event()
    for _ in range(int(SECONDS / 0.005)):
        if any(used.users == users for used in list(locks._used.values())):
            return
        pause.wait(0.005)
    raise AssertionError("nobody waits")


@pytest.mark.parametrize("end", ["at", "answering"])
def test_a_put_during_which_the_process_ends_is_what_is_drawn(server: Server, end: str) -> None:
    """A tile that is asked for meanwhile brings the old positions back to no process."""
    with threads() as pool:
        asked: list[Future[float]] = []

        def end_process() -> None:
            server.caller.restart()
            asked.append(pool.submit(server.drawn))
            await_waiting(server.ledger._sending, 2)

        getattr(server.caller, end)["frames.put"] = end_process
        server.frames.put("a", "smile", frame(2.0))
        assert asked[0].result(SECONDS) == 2.0
    assert server.caller.process.puts == [2.0]
    assert server.drawn() == 2.0
    server.caller.restart()
    assert server.drawn() == 2.0


@pytest.mark.parametrize("end", ["at", "answering"])
def test_a_frame_that_is_deleted_while_the_process_ends_does_not_come_back(
    server: Server, end: str
) -> None:
    with threads() as pool:
        asked: list[Future[float]] = []

        def end_process() -> None:
            server.caller.restart()
            asked.append(pool.submit(server.drawn))
            await_waiting(server.ledger._sending, 2)

        getattr(server.caller, end)["frames.delete"] = end_process
        server.frames.delete("a", "smile")
        with pytest.raises(NotFoundError):
            asked[0].result(SECONDS)
    assert server.caller.process.frames == {}
    for _ in range(2):
        with pytest.raises(NotFoundError):
            server.drawn()
        server.caller.restart()


def test_a_frame_that_is_brought_back_gives_way_to_one_that_is_stored(server: Server) -> None:
    server.caller.restart()
    with threads() as pool:
        stored: list[Future[Any]] = []

        def store() -> None:
            stored.append(pool.submit(server.frames.put, "a", "smile", frame(2.0)))
            await_waiting(server.ledger._sending, 2)

        server.caller.at["frames.put"] = store
        assert server.drawn() in (1.0, 2.0)
        stored[0].result(SECONDS)
    assert server.caller.process.puts == [1.0, 2.0]
    assert server.drawn() == 2.0


@pytest.mark.parametrize("change", ["put", "bring"])
def test_what_is_stored_is_not_given_up_where_its_client_is_gone(
    server: Server, change: str
) -> None:
    """The process would store it later, after what is stored by then."""
    gone: list[bool] = []
    server.caller.at["frames.put"] = lambda: gone.append(call_context.is_abandoned())
    with call_context.abandoned_when(lambda: True):
        if change == "put":
            server.frames.put("a", "smile", frame(2.0))
        else:
            server.caller.restart()
            server.drawn()
    assert gone == [False]


@pytest.mark.parametrize("change", ["put", "delete"])
def test_a_change_without_an_answer_leaves_the_frame_that_there_was(
    server: Server, change: str
) -> None:
    def lose() -> None:
        raise DeviceLostError("the process of the device does not answer")

    server.caller.answering[f"frames.{change}"] = lose
    changed = (frame(2.0),) if change == "put" else ()
    with pytest.raises(DeviceLostError):
        getattr(server.frames, change)("a", "smile", *changed)
    assert server.drawn() == 1.0
    server.caller.restart()
    assert server.drawn() == 1.0


def test_a_removed_asset_takes_its_frames_along(server: Server) -> None:
    """Also one that is just brought back, and one that was sent before it was removed."""
    server.caller.restart()
    with threads() as pool:
        removed: list[Future[None]] = []

        def remove() -> None:
            removed.append(pool.submit(server.assets.delete, "a"))
            await_waiting(server.ledger._sending, 2)

        server.caller.at["frames.put"] = remove
        server.drawn()
        removed[0].result(SECONDS)
    server.caller.answering["frames.put"] = lambda: server.assets.delete("a")
    server.frames.put("a", "other", frame(3.0))
    server.caller.answering["assets.create"] = lambda: server.assets.delete("a")
    server.create()
    server.caller.restart()
    assert server.frames.all("a") == []
    assert server.ledger.names("a") == []


def test_a_frame_that_is_stored_beside_an_upload_stays(server: Server) -> None:
    server.caller.answering["assets.create"] = lambda: (
        server.frames.put("a", "0001", frame(5.0)) and None
    )
    server.create()
    assert server.frames.all("a") == ["0001", "smile"]
    assert server.caller.process.frames["0001"] == 5.0
    server.caller.restart()
    server.frames.all("a")
    assert server.caller.process.frames["0001"] == 5.0


def test_a_list_has_what_was_stored_before_it_was_sent_again(server: Server) -> None:
    def end_process() -> None:
        server.frames.put("a", "later", frame(2.0))
        server.caller.restart()

    server.caller.at["frames.all"] = end_process
    assert server.frames.all("a") == ["later", "smile"]


def test_many_threads_see_what_was_stored_last(server: Server) -> None:
    """Puts of growing numbers, readers and ends of processes at random: no reader sees a number
    that is smaller than one that was answered before it asked."""
    answered, over, wrong = [1.0], threading.Event(), list[str]()

    def read() -> None:
        while not over.is_set():
            least = answered[-1]
            found = server.drawn()
            if found < least:
                wrong.append(f"{found} after {least}")

    def end() -> None:
        while not over.is_set():
            server.caller.restart()
            over.wait(0.002)

    with threads() as pool:
        pool.submit(end)
        readers = [pool.submit(read) for _ in range(2)]
        try:
            for value in range(2, 42):
                server.frames.put("a", "smile", frame(value))
                answered.append(float(value))
                over.wait(0.002)
        finally:
            over.set()
        for reader in readers:
            reader.result(SECONDS)
    assert wrong == []


def test_positions_that_are_not_stored_are_sent_once(tmp_path: Path) -> None:
    """Every call that takes them knows them by their digest from then on."""
    sent: list[bool] = []

    with running(tmp_path) as engine:

        def call(request: Request, prepare: Any = None) -> Any:
            assert request.unstored is not None
            sent.append(request.unstored.positions is not None)
            return request.envelope.perform(engine)

        asset = built(engine, new_asset())
        uploads = UploadHolds(ByteBudget(0, "RHYTID_HOST_MEMORY_MB"))
        transport = cast(Any, SimpleNamespace(call=call))
        ledger = FrameLedger(0, cast(Any, None))
        remote = Proxy(RemoteCalls(transport, ledger, JobLedger(), uploads))
        bent = Frame.of(1.1 * engine.frames.positions(asset, "neutral"))
        tiles = set()
        for _ in range(3):
            remote.frames.warnings(asset, bent)
            tiles.add(remote.tiles.draw(asset, bent, MapQuery(), WHOLE).tile.tobytes())
        assert remote.assets.calibrate(asset, bent).kind == "calibration"
        assert len(tiles) == 1
        assert sent == [True] + 6 * [False]
        # Beside many others they are forgotten, and sent again.
        engine.assets._assets.frame_memory._recent.clear()
        remote.frames.warnings(asset, bent)
        assert sent[-2:] == [False, True]
