"""Assets of several devices: where they go, and where requests for them do."""

from __future__ import annotations

import dataclasses
import tempfile
import threading
import tracemalloc
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.engines import new_asset
from rhytid.domain.mesh import Mesh
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.engine.assets.upload import CheckedUpload, content_id
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.messages import AssetInfo, JobInfo
from rhytid.engine.operations import OPERATIONS, Jobs, Proxy
from rhytid.errors import DeviceLostError, LimitError, NoDeviceError, NotFoundError, SnapshotError
from rhytid.processes import supervisors
from rhytid.processes.envelope import Request
from rhytid.processes.frame_ledger import FrameLedger
from rhytid.processes.job_ledger import JobLedger
from rhytid.processes.keyed_locks import KeyedLocks
from rhytid.processes.placement import FoundDevice, Placement, named_devices, settings_of
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds
from rhytid.processes.supervisors import Supervisors
from rhytid.storage.snapshots import OpenFile
from rhytid.support.settings import ServiceSettings

GIB = 1 << 30
GPUS = [FoundDevice(0, "gpu", "gpu", 8 * GIB), FoundDevice(1, "gpu", "gpu", 24 * GIB)]
CPUS = [FoundDevice(2, "one", "cpu", 6 * GIB), FoundDevice(3, "other", "cpu", 6 * GIB)]


def test_equal_devices_take_turns() -> None:
    placement = Placement([100, 100])
    assert [placement.place(name, 10)[0] for name in "abcd"] == [0, 1, 0, 1]


def test_a_large_asset_is_made_up_for() -> None:
    placement = Placement([100, 100])
    assert [placement.place(n, b)[0] for n, b in (("a", 50), ("b", 10), ("c", 10))] == [0, 1, 1]


def test_an_asset_stays_and_its_room_comes_back() -> None:
    placement = Placement([100, 100])
    assert placement.place("a", 60) == (0, True)
    assert placement.place("a", 60) == (0, False)
    placement.place("b", 10)
    placement.forget("a")
    placement.forget("none")
    assert (placement.of("a"), placement.of("b")) == (None, 1)
    assert placement.place("c", 1) == (0, True)
    assert placement.on(0) == {"c"}


@given(st.lists(st.integers(1, 50), max_size=40), st.lists(st.integers(1000, 9000), min_size=1))
def test_no_device_is_fuller_than_the_others_by_more_than_one_asset(
    sizes: list[int], limits: list[int]
) -> None:
    placement = Placement(limits)
    placed = [0] * len(limits)
    for number, nbytes in enumerate(sizes):
        device, _ = placement.place(str(number), nbytes)
        placed[device] += nbytes
    shares = [used / limit for used, limit in zip(placed, limits, strict=True)]
    assert max(shares) - min(shares) <= max(sizes, default=0) / min(limits) + 1e-9


def test_devices_are_named_by_number() -> None:
    found = [*GPUS, *CPUS]
    assert named_devices(("all",), found) == found
    assert named_devices(("3", "0", "3"), found) == [CPUS[1], GPUS[0]]
    with pytest.raises(NoDeviceError, match="'7'"):
        named_devices(("0", "7"), found)


def test_processors_share_the_memory_of_the_machine() -> None:
    found, usual = [*GPUS, *CPUS], ServiceSettings()
    shares = [settings_of(one, found, usual).device_memory for one in found]
    assert shares == [8 * GIB, 24 * GIB, 3 * GIB, 3 * GIB]
    given = settings_of(CPUS[0], found, ServiceSettings(device_memory=5))
    assert (given.device_memory, given.device) == (5, "2")


def test_devices_share_the_memory_of_frames() -> None:
    found, given = [*GPUS, *CPUS], ServiceSettings(frame_memory=GIB)
    assert {settings_of(one, found, given).frame_memory for one in found} == {GIB // 4}


class One:
    """A device's supervisor that knows assets, and lists what it is asked."""

    def __init__(self) -> None:
        self.known: set[str] = set()
        self.asked: list[str] = []
        self.fails: Exception | None = None
        self.lost = False
        self.forgotten: list[str] = []
        # Done when an asset is removed, before the answer.
        self.then: Callable[[], object] = lambda: None

    def forget(self, asset: str) -> None:
        self.forgotten.append(asset)

    def mark(self, asset: str, frame: str) -> object:
        return self, asset, frame

    @property
    def ready(self) -> object | None:
        return None if self.lost else self

    def call(self, request: Request, prepare: Any = None) -> Any:
        self.asked.append(request.operation.name)
        if self.lost:
            raise DeviceLostError("lost")
        if request.operation.name == "assets.create":
            if self.fails:
                raise self.fails
            self.known.add(content_id(request.positional[0]))
            return "created"
        if request.operation.name == "assets.all":
            return sorted(self.known)
        if request.positional[0] not in self.known:
            raise NotFoundError(request.positional[0])
        if request.operation.name == "assets.delete":
            self.known.remove(request.positional[0])
            self.then()
        return request.operation.name


@pytest.fixture
def two() -> Supervisors:
    made = Supervisors.__new__(Supervisors)
    made.all = [One(), One()]  # type: ignore[list-item]
    made._shared = False
    made._placement, made._changing = Placement([1 << 40, 1 << 40]), KeyedLocks()
    return made


def sent(seed: int) -> Request:
    return Request(OPERATIONS["assets.create"], (new_asset(seed=seed),))


def test_requests_go_to_the_device_of_their_asset(two: Supervisors) -> None:
    requests = [sent(seed) for seed in (1, 2, 3)]
    ids = [content_id(request.positional[0]) for request in requests]
    for request in (*requests, *requests):
        assert two.call(request) == "created"
    first, second = (one.known for one in two.all)  # type: ignore[attr-defined]
    assert (first, second) == ({ids[0], ids[2]}, {ids[1]})
    for id in ids:
        assert two.call(Request(OPERATIONS["frames.all"], (id,))) == "frames.all"
    assert two.call(Request(OPERATIONS["assets.all"])) == [*sorted(first), ids[1]]
    two.call(Request(OPERATIONS["assets.delete"], (ids[1],)))
    with pytest.raises(NotFoundError):
        two.call(Request(OPERATIONS["frames.all"], (ids[1],)))
    assert two._placement.on(1) == frozenset()


def test_marks_are_those_of_the_device_of_an_asset(two: Supervisors) -> None:
    """Another device may fetch an asset that is on none."""
    requests = [sent(seed) for seed in (1, 2)]
    for device, request in zip(two.all, requests, strict=True):
        id = content_id(request.positional[0])
        assert two.mark(id, "smile") is None
        two.call(request)
        assert two.mark(id, "smile") == (device, id, "smile")


def test_an_asset_that_is_fetched_stays_where_it_was_asked_for(two: Supervisors) -> None:
    """A shared store may have what no device has yet."""
    two._shared = True
    second = two.all[1]
    two.call(sent(1))
    fetched, missing = "a" * 16, "b" * 16
    second.known.add(fetched)  # type: ignore[attr-defined] the device that has more room finds it
    assert two._placement.of(fetched) is None

    assert two.call(Request(OPERATIONS["frames.all"], (fetched,))) == "frames.all"
    assert two._placement.of(fetched) == 1
    for asset in (missing, "no-id"):
        with pytest.raises(NotFoundError):
            two.call(Request(OPERATIONS["frames.all"], (asset,)))
        assert two._placement.of(asset) is None

    second.lost = True  # type: ignore[attr-defined]
    with pytest.raises(DeviceLostError):
        two.call(Request(OPERATIONS["frames.all"], (fetched,)))
    assert two._placement.of(fetched) == 1


def test_a_job_is_found_on_whichever_device_it_is(two: Supervisors) -> None:
    two.all[1].known.add("job")  # type: ignore[attr-defined]
    assert two.call(Request(OPERATIONS["jobs.info"], ("job",))) == "jobs.info"
    with pytest.raises(NotFoundError):
        two.call(Request(OPERATIONS["jobs.info"], ("none",)))


def test_what_is_deleted_is_forgotten_on_its_own_device(two: Supervisors) -> None:
    for seed in (1, 2):
        two.call(sent(seed))
    id = content_id(sent(2).positional[0])
    delete = Request(OPERATIONS["assets.delete"], (id,))
    two.call(delete)
    assert [one.forgotten for one in two.all] == [[], [id]]  # type: ignore[attr-defined]
    two._placement.place("lost before", 2)
    number = two._placement.place("unknown", 1)[0]
    with pytest.raises(NotFoundError):
        two.call(Request(OPERATIONS["assets.delete"], ("unknown",)))
    assert two.all[number].forgotten[-1] == "unknown"  # type: ignore[attr-defined]
    assert two._placement.of("unknown") is None


def test_an_asset_that_is_sent_while_it_is_deleted_keeps_its_device(two: Supervisors) -> None:
    two.call(sent(1))
    id = content_id(sent(1).positional[0])
    again = threading.Thread(target=two.call, args=(sent(1),))

    def send() -> None:
        again.start()
        again.join(0.05)

    two.all[0].then = send  # type: ignore[attr-defined]
    two.call(Request(OPERATIONS["assets.delete"], (id,)))
    again.join()
    knows = [id in one.known for one in two.all]  # type: ignore[attr-defined]
    assert knows.index(True) == two._placement.of(id)
    assert len(two._changing) == 0


def test_a_lost_device_does_not_keep_jobs_of_the_others(two: Supervisors) -> None:
    first, second = two.all
    first.lost = True  # type: ignore[attr-defined]
    two._placement.place("other", 1)
    assert two._placement.place("asset", 1) == (1, True)
    second.known.update(("job", "found"))  # type: ignore[attr-defined]
    for name in ("jobs.info", "jobs.cancel"):
        assert two.call(Request(OPERATIONS[name], ("job",), of="asset")) == name
        assert two.call(Request(OPERATIONS[name], ("found",))) == name
    assert first.asked == []  # type: ignore[attr-defined]
    with pytest.raises(DeviceLostError):
        two.call(Request(OPERATIONS["jobs.info"], ("none",)))


def test_assets_are_listed_all_or_not_at_all(two: Supervisors) -> None:
    two.all[0].lost = True  # type: ignore[attr-defined]
    with pytest.raises(DeviceLostError):
        two.call(Request(OPERATIONS["assets.all"]))


def jobs_over(call: Callable[[Request], Any], ledger: JobLedger) -> Jobs:
    """The jobs of an engine that answers as `call` does."""
    transport: Any = SimpleNamespace(call=call)
    uploads = UploadHolds(ByteBudget(0, "RHYTID_HOST_MEMORY_MB"))
    return Proxy(RemoteCalls(transport, FrameLedger(0, cast(Any, None)), ledger, uploads)).jobs


def test_jobs_are_asked_for_with_their_asset() -> None:
    asked: list[tuple[str, str]] = []
    job = JobInfo("job", "asset", "build", "running", 0.0, "", "")

    def call(request: Request) -> JobInfo:
        asked.append((request.operation.name, request.of))
        return job

    ledger = JobLedger()
    ledger.note("job", "asset")
    jobs = jobs_over(call, ledger)
    jobs.info("job")
    jobs.cancel("job")
    expected = ["jobs.info", "jobs.cancel"]
    assert asked == [(name, "asset") for name in expected]


def test_of_a_snapshot_the_beginning_alone_is_read() -> None:
    with tempfile.TemporaryFile() as file:
        file.truncate(1 << 24)
        tracemalloc.start()
        with pytest.raises(SnapshotError):
            supervisors._content(OpenFile(file.fileno()))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 1 << 20


def test_what_is_refused_takes_no_room(two: Supervisors) -> None:
    two.all[0].fails = LimitError("too large")  # type: ignore[attr-defined]
    for _ in range(3):
        with pytest.raises(LimitError):
            two.call(sent(1))
    assert two._placement.on(0) == frozenset()


def test_an_upload_has_its_id_before_it_is_checked() -> None:
    limit: Any = type("Limit", (), {"check": lambda *_: None, "__getattr__": lambda *_: None})()
    given = new_asset(seed=5)
    grown = type(given)(Mesh(*vars(given.mesh).values()), given.settings, None)
    assert content_id(grown) == CheckedUpload.of(grown, GIB, limit).id
    assert supervisors._content(grown)[0] == content_id(grown)
    assert content_id(given) != content_id(grown)


def test_scanned_skin_is_placed_by_its_residual_too() -> None:
    given = new_asset(seed=5)
    maps = {1001: np.ones((256, 256), np.float32)}
    plain = supervisors._content(given)[1]
    with_residual = dataclasses.replace(given, residual=Residual.of(maps))
    assert supervisors._content(with_residual)[1] == plain + 2 * 256**2
    traced = [dataclasses.replace(given, graph=None, scan=s) for s in (ScanRelief(maps), None)]
    one, other = (supervisors._content(new)[1] for new in traced)
    assert one == other + 2 * 256**2


def test_a_build_whose_process_ended_before_anyone_asked_goes_on() -> None:
    """The answer with its id came, and the process was gone: a new one builds under another id."""
    building = AssetInfo("asset", "building", "new", None, {}, (), 1, 3, 1, 0, 0)
    jobs = {"new": JobInfo("new", "asset", "build", "running", 0.5, "pores", "")}

    def call(request: Request) -> object:
        if request.operation.name == "assets.info":
            return building
        if request.positional[0] not in jobs:
            raise NotFoundError("no such job")
        return jobs[request.positional[0]]

    ledger = JobLedger()
    ledger.note("old", "asset")
    remote = jobs_over(call, ledger)
    found = remote.info("old")
    assert (found.id, found.state, found.stage) == ("old", "running", "pores")
    with pytest.raises(NotFoundError):
        remote.info("of nobody")
