"""Jobs of every kind stop wherever they are when they are cancelled: a walk through all stages, and
a walk through all places that ask whether to go on."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from engine.engines import built, new_asset, rest, running
from meshes import deform
from pipeline.scenes import settings_of, sheet
from rhytid.engine.engine import Engine
from rhytid.engine.job import Job
from rhytid.engine.messages import JobInfo, NewAsset
from rhytid.errors import CancelledError, FetchingError
from rhytid.support import cancellation
from storage.backends import new_folder

pytestmark = pytest.mark.slow
# Places that ask whether to go on, of all in a build, at which one is cancelled.
PLACES = 24
_seeds = count(1)


class Stopper:
    """Cancels the next job of a kind as a stage of it begins, or where its thread asks so many
    times whether to go on; writes down its stages, and how often its thread asks. Threads that
    help it are not counted: one may ask before it hears that the job ends.

    late: later stages that it came to though it was cancelled.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._progress, self._check = Job.progress, Job.check
        monkeypatch.setattr(Job, "progress", lambda *about: self._reported(*about))
        monkeypatch.setattr(Job, "check", lambda job: self._asked(job))
        self.begin("")

    def begin(self, kind: str, stage: str = "", asked: int = -1) -> None:
        self.kind, self.stage, self.at = kind, stage, asked
        self.stages: list[str] = []
        self.late: list[str] = []
        self.asked = 0
        self.job: Job | None = None
        self.thread: threading.Thread | None = None
        self._cancelled = False

    @property
    def info(self) -> JobInfo:
        assert self.job is not None
        assert self.job.wait(60), self.job.info
        return self.job.info

    def _reported(self, job: Job, share: float, stage: str, detail: str = "") -> None:
        if self._is_it(job) and self._cancelled and stage != self.stages[-1]:
            self.late.append(stage)
        self._progress(job, share, stage, detail)
        if not self._is_it(job):
            return
        if stage not in self.stages:
            self.stages.append(stage)
        if stage == self.stage:
            self._cancel(job)

    def _asked(self, job: Job) -> None:
        if self._is_it(job) and threading.current_thread() is self.thread:
            self.asked += 1
            if self.asked == self.at:
                self._cancel(job)
        self._check(job)

    def _is_it(self, job: Job) -> bool:
        if self.job is None and job.info.kind == self.kind:
            self.job, self.thread = job, threading.current_thread()
        return job is self.job

    def _cancel(self, job: Job) -> None:
        self._cancelled = True
        job.cancel()


@pytest.fixture
def stopper(monkeypatch: pytest.MonkeyPatch) -> Stopper:
    return Stopper(monkeypatch)


def grown(seed: int, *, frames: bool = True) -> NewAsset:
    """An asset whose graph is synthesised, over seams, with two frames."""
    settings = settings_of(graph={"wrinkles": 300, "seed": seed}, depth=None)
    moved = np.stack([deform(sheet().positions, n, 0.1) for n in (1, 2)])
    return NewAsset(sheet(), settings, frames=moved if frames else None)


def quiet(engine: Engine) -> None:
    """Wait for all jobs, and for those that these start."""
    rest(engine)
    rest(engine)


def build(engine: Engine, seed: int) -> None:
    engine.assets.create(grown(seed))
    quiet(engine)


def placed(engine: Engine, seed: int) -> None:
    """Of an asset with a graph of its own: what is left is the work of the device and the store."""
    engine.assets.create(new_asset(seed=seed))
    quiet(engine)


def calibrate(engine: Engine, seed: int) -> None:
    asset = built(engine, new_asset(seed=seed))
    engine.assets.calibrate(asset, deform(sheet().positions, 3, 0.15))
    quiet(engine)


def package(engine: Engine, seed: int) -> None:
    asset = built(engine, new_asset(seed=seed, preset="best"))
    with suppress(CancelledError):
        while isinstance(engine.packages.of(asset), JobInfo):
            quiet(engine)


def frames(engine: Engine, seed: int) -> None:
    new = new_asset(seed=seed)
    built(engine, new)
    moved = np.stack([deform(sheet().positions, n, 0.1) for n in (1, 2)])
    engine.assets.create(replace(new, frames=moved))
    quiet(engine)


JOBS: dict[str, Callable[[Engine, int], None]] = {
    "build": build,
    "bins": placed,
    "calibration": calibrate,
    "package": package,
    "frames": frames,
}
# A build with frames that has come to these has made its asset, which stays.
MADE = ("frames", "done")


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path / "store") as engine:
        yield engine


@pytest.mark.parametrize("kind", JOBS)
def test_a_job_that_is_cancelled_ends_in_the_stage_that_it_is_in(
    engine: Engine, stopper: Stopper, kind: str
) -> None:
    stopper.begin(kind)
    JOBS[kind](engine, next(_seeds))
    assert stopper.info.state == "done"
    stages = stopper.stages
    assert len(stages) > 1
    for stage in stages:
        stopper.begin(kind, stage)
        JOBS[kind](engine, next(_seeds))
        assert (stage, stopper.info.state) == (stage, "cancelled")
        # It did not first do all of the stage. There is nothing to do before the first one.
        assert (stopper.stages[-1], stopper.late) == (stage, []) or stage == "starting"
        if kind == "build" and stage not in MADE:
            assert engine.assets.info(stopper.info.asset).state == "failed"
    assert engine._store._folders.partial.is_dir()
    assert list(engine._store._folders.partial.iterdir()) == []


def test_every_stage_of_a_build_is_walked_through(engine: Engine, stopper: Stopper) -> None:
    """So that a stage that is renamed, or new, is in the test above."""
    stopper.begin("build")
    build(engine, next(_seeds))
    known = ["starting", "pores", "edges", "crossings", "directions", "trails", "selection"]
    known += ["shapes", "placing pores and wrinkles", "storing", "uploading", "frames"]
    assert sorted(stopper.stages) == sorted(known)


def test_a_build_stops_wherever_it_asks(engine: Engine, stopper: Stopper) -> None:
    stopper.begin("build")
    build(engine, next(_seeds))
    for asked in np.unique(np.linspace(1, 0.9 * stopper.asked, PLACES).astype(int)):
        stopper.begin("build", asked=int(asked))
        build(engine, next(_seeds))
        assert stopper.info.state == "cancelled"
        # Nothing swallows what stops it.
        assert stopper.asked == asked
        stopper.begin("")


def test_what_a_stopped_build_held_is_given_back(engine: Engine, stopper: Stopper) -> None:
    build(engine, next(_seeds))
    before = engine._device.budget.used
    for stage in ("trails", "shapes", "placing pores and wrinkles", "storing", "uploading"):
        stopper.begin("build", stage)
        build(engine, next(_seeds))
        assert (stage, engine._device.budget.used) == (stage, before)


@pytest.mark.parametrize("kind", ["push", "fetch"])
def test_transfers_that_are_cancelled_end(tmp_path: Path, stopper: Stopper, kind: str) -> None:
    place = str(new_folder(tmp_path))

    def once(engine: Engine, seed: int) -> None:
        if kind == "push":
            return placed(engine, seed)
        with running(tmp_path / f"other {seed}", shared_store=place) as other:
            with suppress(CancelledError, FetchingError):
                other.assets.info(asset)
            quiet(other)
        return None

    with running(tmp_path / "store", shared_store=place) as engine:
        asset = built(engine, new_asset(seed=next(_seeds)))
        stopper.begin(kind)
        once(engine, next(_seeds))
        assert stopper.info.state == "done"
        for stage in stopper.stages:
            stopper.begin(kind, stage)
            once(engine, next(_seeds))
            assert (stage, stopper.info.state) == (stage, "cancelled")
            assert stopper.late == [] or stage == "starting"


def test_a_build_that_waits_is_given_up_at_once(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its asset does not stay `building`, and may be asked for again."""
    busy, free = threading.Event(), threading.Event()

    def keep(job: Job) -> None:
        busy.set()
        assert free.wait(60)

    engine.jobs.start("build", "busy", keep)
    assert busy.wait(60)
    engine.jobs.start("build", "busy too", keep, small=True)
    monkeypatch.setattr("rhytid.engine.assets.asset.Asset.small", False)
    new = new_asset(seed=next(_seeds))
    info = engine.assets.create(new)
    assert info.job is not None
    assert engine.jobs.cancel(info.job).state == "cancelled"
    assert engine.assets.info(info.id).state == "failed"
    free.set()
    quiet(engine)
    assert built(engine, new) == info.id


def test_work_outside_of_jobs_is_never_stopped() -> None:
    cancellation.check()
    assert list(cancellation.check_each(range(3))) == [0, 1, 2]
