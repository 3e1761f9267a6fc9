"""What the server keeps of frames, jobs and refusals while processes come and go."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rhytid.device.watch import SIZE, Purpose, Report
from rhytid.domain.tiles import MapAddress, TileGrid
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.messages import STARTED_AGAIN, AssetDimensions, AssetInfo, JobInfo, MapQuery
from rhytid.engine.operations import OPERATIONS, Proxy
from rhytid.errors import FatalRequestError, NotFoundError
from rhytid.processes.device_process import Ending, ending_of
from rhytid.processes.envelope import Request
from rhytid.processes.frame_ledger import FrameLedger
from rhytid.processes.job_ledger import JobLedger, resumed
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds
from rhytid.processes.supervisor import Refusals
from rhytid.processes.wire import BuildChanged

ONE, OTHER = cast(Any, "process 1"), cast(Any, "process 2")
FRAME = np.ones((10, 3), np.float32)
DRAW = OPERATIONS["tiles.draw"]
JOB = JobInfo("j", "a", "build", "running", 0.5, "trails", "")
ASSET = AssetInfo("a", "ready", None, None, {}, (), 1, 3, 1, 0, 0)
SEGV = Ending("fault", "it ended by SIGSEGV", Purpose())
TOO_LATE = Ending("late", "a call of the OpenCL driver took more than 60 seconds", Purpose())


def test_frames_are_sent_once_to_every_new_process() -> None:
    sent: list[tuple[Any, ...]] = []
    ledger = FrameLedger(1000, lambda *put: sent.append(put[:3]))
    ledger.keep("a", "smile", FRAME, ONE, ledger.mark())
    ledger.bring(ONE, "a", ["smile", "unknown"])
    assert sent == []
    for _ in range(2):
        ledger.bring(OTHER, "a", ["smile"])
    assert sent == [(OTHER, "a", "smile")]
    version = ledger.version("a", "smile")
    ledger.keep("a", "smile", 2 * FRAME, OTHER, ledger.mark())
    assert ledger.version("a", "smile") != version
    ledger.forget("a")
    assert (ledger.names("a"), ledger.version("a", "smile")) == ([], 0)


def test_a_frame_that_is_being_sent_keeps_no_other() -> None:
    ledger = FrameLedger(1000, lambda *_: None)
    sent: list[str] = []

    def send_others() -> None:
        for number in range(200):
            with ledger.sending("b", str(number)):
                sent.append(str(number))

    others = threading.Thread(target=send_others, daemon=True)
    with ledger.sending("a", "smile"), ledger.sending("a", "smile"):
        others.start()
        others.join(5)
        assert len(sent) == 200
    assert len(ledger._sending) == 0


@pytest.mark.parametrize("meanwhile", ["sent", "stored", "deleted"])
def test_a_frame_is_looked_up_again_by_a_thread_that_waited_to_send_it(meanwhile: str) -> None:
    """Two threads bring a frame to a new process, which gets it once; what was stored or deleted
    while they waited is not undone."""
    sent: list[float] = []
    ledger = FrameLedger(10_000, lambda process, asset, name, found: sent.append(found[0, 0]))
    ledger.keep("a", "smile", FRAME, ONE, ledger.mark())
    looked = threading.Barrier(3)
    lacked = ledger._lacked

    def look(*arguments: Any) -> Any:
        found = lacked(*arguments)
        if not waiting.is_set():
            looked.wait(10)  # both have seen that the process lacks it
        return found

    waiting = threading.Event()
    ledger._lacked = look  # type: ignore[method-assign]
    with ThreadPoolExecutor(2) as pool, ledger.sending("a", "smile"):
        bringing = [pool.submit(ledger.bring, OTHER, "a", ["smile"]) for _ in range(2)]
        looked.wait(10)
        waiting.set()
        if meanwhile == "stored":
            ledger.keep("a", "smile", 2 * FRAME, ONE, ledger.mark())
        elif meanwhile == "deleted":
            ledger.forget("a", "smile")
    for one in bringing:
        one.result(10)
    assert sent == {"sent": [1.0], "stored": [2.0], "deleted": []}[meanwhile]


def test_frames_beyond_the_limit_are_not_kept() -> None:
    ledger = FrameLedger(FRAME.nbytes, lambda *_: None)
    ledger.keep("a", "one", FRAME, ONE, ledger.mark())
    ledger.keep("a", "two", FRAME, ONE, ledger.mark())
    assert ledger.names("a") == ["one"]
    ledger.keep("a", "one", FRAME, ONE, ledger.mark())
    ledger.forget("a", "one")
    ledger.keep("a", "two", FRAME, ONE, ledger.mark())
    assert ledger.names("a") == ["two"]


@pytest.mark.parametrize(
    ("kind", "asset", "state"),
    [
        ("build", ASSET, "done"),
        ("frames", ASSET, "done"),
        ("calibration", ASSET, "failed"),
        ("bins", ASSET, "failed"),
        ("build", replace(ASSET, state="failed", reason="why"), "failed"),
        ("build", replace(ASSET, state="building", job="new"), "queued"),
        ("build", None, "failed"),
    ],
)
def test_a_job_of_an_ended_process_is_what_became_of_it(
    kind: str, asset: AssetInfo | None, state: str
) -> None:
    def find(id: str) -> AssetInfo:
        if asset is None:
            raise NotFoundError
        return asset

    ledger = JobLedger()
    ledger.keep(replace(JOB, kind=kind))
    assert ledger.lost("j") is None
    ledger.lose()
    lost = ledger.lost("j")
    assert lost is not None
    now = resumed(lost, find, lambda id: replace(JOB, id=id, state="queued"))
    assert (now.id, now.state) == ("j", state)


def test_a_job_that_is_lost_is_cancelled_after_it_was_asked_for() -> None:
    """Its build goes on under another id, which its old one stands for until the end."""
    jobs = {"new": replace(JOB, id="new")}

    def call(request: Request, prepare: Any = None) -> Any:
        if request.operation.name == "assets.info":
            return replace(ASSET, state="building", job="new")
        if request.positional[0] not in jobs:
            raise NotFoundError("no such job")
        if request.operation.name == "jobs.cancel":
            jobs["new"] = replace(jobs["new"], state="cancelled")
        return jobs[request.positional[0]]

    ledger = JobLedger()
    ledger.keep(JOB)
    ledger.lose()
    remote = calls_over(call, jobs=ledger).jobs
    assert (remote.info("j").id, remote.info("j").state) == ("j", "running")
    assert (remote.cancel("j").id, remote.cancel("j").state) == ("j", "cancelled")


def test_a_build_is_not_lost_with_its_process_until_it_has_ended() -> None:
    """The next process has it under the same id; the end of an earlier build of the same asset,
    told late, changes nothing."""
    ledger = JobLedger()
    for id in ("j", "frames", "new"):
        ledger.keep(replace(JOB, id=id))
    ledger.note_build(BuildChanged("a", "j", ended=False))
    ledger.lose()
    assert [ledger.lost(id) is None for id in ("j", "frames")] == [True, False]
    assert ledger.builds() == {"a": "j"}
    ledger.note_build(BuildChanged("a", "new", ended=False))
    ledger.note_build(BuildChanged("a", "j", ended=True))
    assert ledger.builds() == {"a": "new"}
    ledger.note_build(BuildChanged("a", "new", ended=True))
    ledger.lose()
    assert ledger.builds() == {}
    assert ledger.lost("j") is not None


@pytest.mark.parametrize("state", ["done", "failed", "cancelled"])
def test_a_lost_build_does_not_end_with_frames_while_its_asset_is_built(state: str) -> None:
    """The asset may name the job that adds frames to it."""
    building = replace(ASSET, state="building", job="frames")
    frames = replace(JOB, id="frames", kind="frames", state=state)
    now = resumed(JOB, lambda id: building, lambda id: frames)
    assert (now.id, now.state, now.detail) == ("j", "running", STARTED_AGAIN)
    for detail in ("", "1 of 2", STARTED_AGAIN, f"{STARTED_AGAIN}; 1 of 2"):
        one = replace(frames, state="running", detail=detail)
        told = resumed(JOB, lambda id: building, lambda id, one=one: one).detail
        assert told == "; ".join([STARTED_AGAIN, *(["1 of 2"] if "1" in detail else [])])


def test_a_job_that_its_process_forgot_is_cancelled_as_what_became_of_it() -> None:
    """Its build ended as its process did."""

    def call(request: Request, prepare: Any = None) -> Any:
        if request.operation.name == "assets.info":
            return ASSET
        raise NotFoundError("no such job")

    ledger = JobLedger()
    ledger.keep(JOB)
    remote = calls_over(call, jobs=ledger).jobs
    assert remote.cancel("j").state == "done"
    with pytest.raises(NotFoundError):
        remote.cancel("of nobody")


def test_a_job_that_this_side_answers_is_remembered() -> None:
    def call(request: Request, prepare: Any = None) -> Any:
        raise NotFoundError("no")

    own = {"packages.of": lambda asset: replace(JOB, kind="package")}
    remote = calls_over(call, own=own)
    assert remote.packages.of("a") == replace(JOB, kind="package")
    assert remote.jobs.info("j").state == "failed"


def calls_over(
    call: Any,
    frames: FrameLedger | None = None,
    jobs: JobLedger | None = None,
    own: Mapping[str, Any] = MappingProxyType({}),
) -> Proxy:
    """An engine whose calls `call` answers, but for its own."""
    transport = cast(Any, SimpleNamespace(call=call, forget=lambda asset: None))
    uploads = UploadHolds(ByteBudget(0, "RHYTID_HOST_MEMORY_MB"))
    ledger = FrameLedger(0, lambda *_: None)
    return Proxy(RemoteCalls(transport, frames or ledger, jobs or JobLedger(), uploads, own))


def test_frames_go_with_an_asset_that_was_removed_elsewhere() -> None:
    """Else they would come back in the next process, with an asset that is sent again."""
    asked: list[str] = []

    def call(request: Request, prepare: Any = None) -> Any:
        asked.append(request.operation.name)
        if request.operation.name == "assets.follow":
            raise NotFoundError("no asset")
        return AssetDimensions("a", 3, 1, (1001,), TileGrid(64, 64), (0.0, 0.0, 0.0))

    ledger = FrameLedger(1000, lambda *_: None)
    ledger.keep("a", "smile", FRAME, ONE, ledger.mark())
    assets = calls_over(call, ledger).assets
    assets.dimensions("a")
    with pytest.raises(NotFoundError):
        assets.follow("a", replace=False)
    assert ledger.names("a") == []
    assets.dimensions("a")
    assert asked.count("assets.dimensions") == 2


def test_the_second_strike_refuses_until_an_answer_or_a_change() -> None:
    refusals = Refusals()

    def draw() -> Request:
        return Request(DRAW, ("a", "smile"), version=3)

    refusals.strike(draw(), SEGV)
    refusals.check(draw())
    refusals.absolve(draw())
    refusals.strike(draw(), SEGV)
    refusals.check(draw())
    refusals.strike(draw(), SEGV)
    with pytest.raises(FatalRequestError, match=r"2 times.*SIGSEGV"):
        refusals.check(draw())
    refusals.check(Request(DRAW, ("a", "smile"), version=4))
    refusals.forget("a")
    refusals.check(draw())


def test_builds_are_refused_after_two_strikes() -> None:
    refusals = Refusals()
    refusals.strike_build("a", SEGV)
    assert refusals.builds() == {}
    refusals.strike_build("a", SEGV)
    assert "its build" in refusals.builds()["a"].reason
    refusals.forget("b")
    assert list(refusals.builds()) == ["a"]
    refusals.forget("a")
    assert refusals.builds() == {}
    refusals.strike_build("a", SEGV)
    assert refusals.builds() == {}


def test_what_was_late_is_refused_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine may have been busy; what is late again is refused for longer."""
    now = 1000.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    refusals, request = Refusals(), Request(DRAW, ("a", "smile"), version=3)

    def strike() -> None:
        refusals.strike(request, TOO_LATE)
        refusals.strike_build("a", TOO_LATE)

    strike()
    for seconds in (600, 1200, 2400):
        strike()
        with pytest.raises(FatalRequestError, match=f"after {seconds // 60} minutes"):
            refusals.check(request)
        assert refusals.builds()["a"].holds
        now += seconds - 1
        assert refusals.builds()["a"].holds
        now += 2
        refusals.check(request)
        assert refusals.builds() == {}
    refusals.strike(request, SEGV)
    now += 1e9
    with pytest.raises(FatalRequestError, match="SIGSEGV"):
        refusals.check(request)


@pytest.mark.parametrize(
    ("status", "late", "kind", "blames"),
    [
        (-11, None, "fault", True),
        (-6, None, "fault", True),
        (1, None, "fault", True),
        (-9, None, "killed", False),
        (-15, None, "killed", False),
        (-9, 60.0, "late", True),
    ],
)
def test_only_faults_and_late_calls_blame_what_was_worked_on(
    status: int, late: float | None, kind: str, blames: bool
) -> None:
    ending = ending_of(status, late, Purpose())
    assert (ending.kind, ending.blames) == (kind, blames)


def test_a_report_tells_what_the_driver_works_for_and_when_it_is_late() -> None:
    memory = memoryview(bytearray(SIZE))
    told, seen = Report(memory), Report(memory)
    told.begin(Purpose(request=7), 3600.0)
    assert (seen.purpose, seen.late, seen.ended) == (Purpose(request=7), False, 0)
    told.end()
    told.begin(Purpose(asset=2**64 - 1), 0.0)
    assert (seen.purpose.asset, seen.ended) == (2**64 - 1, 1)
    assert seen.late
    told.end()
    assert not seen.late


def test_a_thread_that_compiles_does_not_hide_a_launch_that_hangs() -> None:
    memory = memoryview(bytearray(SIZE))
    told, seen = Report(memory), Report(memory)

    def compile_one() -> None:
        told.begin(Purpose(request=2), 600.0)
        assert seen.late
        assert seen.purpose == Purpose(request=1)
        told.end()

    told.begin(Purpose(request=1), 0.0)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(compile_one).result()
    assert (seen.late, seen.purpose, seen.ended) == (True, Purpose(request=1), 1)
    told.end()
    assert not seen.late


def test_what_never_changes_is_asked_once_until_the_asset_is_removed() -> None:
    asked: list[str] = []

    def call(request: Request, prepare: Any = None) -> Any:
        asked.append(request.operation.name)
        sizes = (3, 1) if request.asset == "a" else (0, 0)
        return AssetDimensions(request.asset, *sizes, (1001,), TileGrid(64, 64), (0.0, 0.0, 0.0))

    assets = calls_over(call).assets
    for _ in range(2):
        assert assets.dimensions("a").vertices == 3
    assets.delete("a")
    assets.dimensions("a")
    assert asked == ["assets.dimensions", "assets.delete", "assets.dimensions"]
    # Of a failed asset nothing is known: it may be sent again.
    for _ in range(2):
        assets.dimensions("failed")
    assert asked[3:] == ["assets.dimensions"] * 2


def test_what_a_call_addresses_may_be_named() -> None:
    """As the signatures of operations say."""
    sent: list[Request] = []
    remote = calls_over(lambda request, prepare=None: sent.append(request))
    remote.tiles.draw(asset="a", frame="smile", query=MapQuery(), place=MapAddress(1001, 0))
    remote.packages.of("a", key="k", begin=False)
    remote.frames.delete(frame="smile", asset="a")
    assert [(one.asset, one.frame) for one in sent] == [("a", "smile"), ("a", ""), ("a", "smile")]
    assert sent[0].positional == ("a", "smile", MapQuery(), MapAddress(1001, 0))
    assert (sent[1].positional, sent[1].named) == (("a",), {"key": "k", "begin": False})


def test_bytes_of_uploads_come_free_with_their_job_or_their_process() -> None:
    memory = ByteBudget(100, "RHYTID_HOST_MEMORY_MB")
    uploads = UploadHolds(memory)
    request = memory.hold("uploads")
    request.grow(60)
    one, other = 1, 2
    uploads.take(one, 40, request)
    uploads.take(other, 30, None)
    assert (memory.used, memory.used_for("jobs")) == (90, 70)
    uploads.release(one)
    uploads.release(one)
    assert memory.used_for("jobs") == 30
    uploads.sent(other, "process")
    uploads.release_of("another")
    assert memory.used_for("jobs") == 30
    uploads.release_of("process")
    uploads.release(other)
    assert memory.used_for("jobs") == 0
