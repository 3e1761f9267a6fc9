"""The queue of jobs: its bound, its order, small jobs beside large ones."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from rhytid.engine.call_context import caller
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.errors import BusyError, CancelledError
from rhytid.support import cancellation

MOST = 4


class Gate:
    """Work that waits to be let go."""

    def __init__(self) -> None:
        self.entered, self.free = threading.Event(), threading.Event()

    def __call__(self, job: Job) -> None:
        self.entered.set()
        assert self.free.wait(60)
        job.progress(0.5, "free")


@pytest.fixture
def jobs() -> Iterator[Jobs]:
    jobs = Jobs(MOST)
    yield jobs
    jobs.close()


@pytest.fixture
def gate(jobs: Jobs) -> Iterator[Gate]:
    """A large job at work."""
    gate = Gate()
    jobs.start("build", "large", gate)
    assert gate.entered.wait(60)
    yield gate
    gate.free.set()


def nothing(job: Job) -> None:
    """A job without work."""


def test_what_fails_at_the_end_of_a_job_keeps_no_other(
    jobs: Jobs, gate: Gate, caplog: pytest.LogCaptureFixture
) -> None:
    called: list[str] = []
    failing = jobs.start("build", "a", nothing)
    failing.when_ended(lambda: {}["absent"])
    failing.when_ended(lambda: called.append("the next"))
    later = jobs.start("build", "b", nothing)
    gate.free.set()
    assert later.wait(60)
    assert (failing.info.state, later.info.state, called) == ("done", "done", ["the next"])
    assert f"the end of job {failing.info.id} failed" in caplog.text


def test_jobs_run_by_kind_then_in_order(jobs: Jobs, gate: Gate) -> None:
    ran: list[str] = []
    order = [("bins", "a"), ("build", "b"), ("calibration", "c"), ("build", "d")]
    started = [
        jobs.start(kind, asset, lambda job, asset=asset: ran.append(asset)) for kind, asset in order
    ]
    gate.free.set()
    assert all(job.wait(60) for job in started)
    assert ran == ["b", "d", "c", "a"]


def test_a_small_job_does_not_wait_for_a_large_one(jobs: Jobs, gate: Gate) -> None:
    large = jobs.start("build", "other", nothing)
    small = jobs.start("build", "tiny", nothing, small=True)
    assert small.wait(60)
    assert not large.ended
    assert not gate.free.is_set()


def test_jobs_of_one_asset_run_one_after_the_other(jobs: Jobs, gate: Gate) -> None:
    again = jobs.start("build", "large", nothing, small=True)
    assert jobs.start("build", "tiny", nothing, small=True).wait(60)
    assert not again.ended
    gate.free.set()
    assert again.wait(60)


def test_a_full_queue_is_busy_and_recovers(jobs: Jobs, gate: Gate) -> None:
    waiting = [jobs.start("build", f"{i}", nothing) for i in range(MOST)]
    with pytest.raises(BusyError, match=r"4 jobs wait already \(RHYTID_JOBS\)"):
        jobs.start("build", "more", nothing)
    must = jobs.start("build", "must", nothing, always=True)
    gate.free.set()
    assert all(job.wait(60) for job in (*waiting, must))
    assert jobs.start("build", "more", nothing).wait(60)


def test_bins_that_still_wait_are_superseded(jobs: Jobs, gate: Gate) -> None:
    first, other, again = (jobs.start("bins", asset, nothing) for asset in ("a", "b", "a"))
    assert (first.info.state, first.info.detail) == ("cancelled", "a newer job does the same")
    gate.free.set()
    assert all(job.wait(60) for job in (other, again))
    assert {job.info.state for job in (other, again)} == {"done"}


def test_a_job_that_waits_is_cancelled(jobs: Jobs, gate: Gate) -> None:
    ran: list[str] = []
    waiting = jobs.start("build", "a", lambda job: ran.append("a"))
    jobs.cancel(waiting.info.id)
    gate.free.set()
    assert waiting.wait(60)
    assert (waiting.info.state, ran) == ("cancelled", [])


def test_an_error_ends_its_job_alone(jobs: Jobs) -> None:
    def fail(job: Job) -> None:
        raise ValueError("unexpected")

    failed = jobs.start("build", "a", fail)
    assert failed.wait(60)
    assert (failed.info.state, failed.info.detail) == ("failed", "internal error: ValueError")
    assert jobs.start("build", "a", nothing).wait(60)


def test_transfers_keep_no_others_waiting(jobs: Jobs) -> None:
    """Not their asset, not the queue, and pushes no fetches."""
    gate = Gate()
    first, *others = (jobs.start("push", f"{n}", gate, always=True) for n in range(2 * MOST))
    assert gate.entered.wait(60)
    for kind, asset in (("build", "0"), ("frames", "0"), ("fetch", "other")):
        assert jobs.start(kind, asset, nothing).wait(60)
    assert first.info.state == "running"
    assert {push.info.state for push in others} == {"queued"}
    gate.free.set()


def test_closing_cancels_what_waits_and_what_is_at_work() -> None:
    jobs, gate = Jobs(MOST), Gate()
    at_work = jobs.start("build", "a", gate)
    waiting = jobs.start("build", "b", nothing)
    assert gate.entered.wait(60)
    threading.Timer(0.1, gate.free.set).start()
    jobs.close()
    assert {job.info.state for job in (at_work, waiting)} == {"cancelled"}
    assert at_work.resumes
    with pytest.raises(CancelledError):
        at_work.progress(1.0, "")


class Pieces:
    """Bins of an asset: pieces of work, before each of which it gives way; done ones stay done."""

    def __init__(self, count: int) -> None:
        self.done: list[int] = []
        self.count, self.runs = count, 0
        self.entered, self.free = threading.Event(), threading.Event()

    def __call__(self, job: Job) -> None:
        self.runs += 1
        for piece in range(self.count):
            job.progress(piece / self.count, "making bins")
            job.give_way()
            if piece not in self.done:
                self.done.append(piece)
                self.entered.set()
                assert self.free.wait(60)


@pytest.mark.parametrize("kind", ["frames", "build", "calibration"])
def test_bins_give_way_to_what_goes_first(jobs: Jobs, kind: str) -> None:
    bins, gate = Pieces(3), Gate()
    job = jobs.start("bins", "large", bins)
    assert bins.entered.wait(60)
    other = jobs.start(kind, "other", gate)
    bins.free.set()
    assert gate.entered.wait(60)  # before the second piece is made
    assert (bins.done, job.info.state) == ([0], "queued")
    assert job.info.progress > 0.0
    gate.free.set()
    assert other.wait(60)
    assert job.wait(60)
    assert (bins.done, bins.runs, job.info.state) == ([0, 1, 2], 2, "done")


@pytest.mark.parametrize(("kind", "asset"), [("build", "large"), ("bins", "other")])
def test_bins_go_on_beside_what_cannot_go_first(jobs: Jobs, kind: str, asset: str) -> None:
    """kind: of a job of the same asset, or of the same rank."""
    bins = Pieces(3)
    job = jobs.start("bins", "large", bins)
    assert bins.entered.wait(60)
    other = jobs.start(kind, asset, nothing)
    bins.free.set()
    assert other.wait(60)
    assert job.wait(60)
    assert (bins.done, bins.runs) == ([0, 1, 2], 1)


def test_small_bins_give_way_to_small_jobs_alone(jobs: Jobs, gate: Gate) -> None:
    bins = Pieces(2)
    job = jobs.start("bins", "small", bins, small=True)
    assert bins.entered.wait(60)
    large = jobs.start("build", "other", nothing)
    bins.free.set()
    assert job.wait(60)
    assert (bins.runs, large.ended) == (1, False)


def test_bins_that_gave_way_are_cancelled_and_superseded(jobs: Jobs) -> None:
    for end in (jobs.cancel, lambda id: jobs.start("bins", "large", nothing)):
        bins, gate = Pieces(3), Gate()
        job = jobs.start("bins", "large", bins)
        assert bins.entered.wait(60)
        jobs.start("build", "other", gate)
        bins.free.set()
        assert gate.entered.wait(60)
        end(job.info.id)
        gate.free.set()
        assert job.wait(60)
        assert (job.info.state, bins.runs) == ("cancelled", 1)


def test_who_wants_to_know_when_a_job_ends_is_told_once(jobs: Jobs, gate: Gate) -> None:
    told: list[str] = []
    waiting = jobs.start("build", "a", nothing)
    waiting.when_ended(lambda: told.append(waiting.info.state))
    assert told == []
    gate.free.set()
    assert waiting.wait(60)
    rest = jobs.start("build", "b", nothing)
    assert rest.wait(60)
    assert told == ["done"]
    waiting.when_ended(lambda: told.append("late"))
    assert told == ["done", "late"]


def test_what_a_job_was_given_is_let_go_at_its_end(jobs: Jobs) -> None:
    class Much:
        pass

    much = Much()
    kept = weakref.ref(much)
    job = jobs.start("build", "a", lambda job, much=much: None)
    del much
    assert job.wait(60)
    end = time.monotonic() + 10
    while kept() is not None and time.monotonic() < end:  # until its thread waits for the next
        time.sleep(0.001)
    assert kept() is None


@contextmanager
def asked_by(name: str) -> Iterator[None]:
    token = caller.set(name)
    yield
    caller.reset(token)


def test_one_caller_does_not_keep_others_waiting(jobs: Jobs) -> None:
    """Not with both lanes, nor with what waits in the queue."""
    gates, started = [Gate(), Gate()], []
    with asked_by("greedy"):
        for n, gate in enumerate(gates):
            jobs.start("build", f"at work {n}", gate, small=True)
            assert gate.entered.wait(60)
        started = [jobs.start("build", f"waits {n}", nothing, small=True) for n in range(2)]
    with asked_by("other"):
        for small in (True, False):
            other = jobs.start("build", f"of another, small: {small}", nothing, small=small)
            assert other.wait(60)
            assert other.info.state == "done"
    assert {job.info.state for job in started} == {"queued"}
    for gate in gates:
        gate.free.set()
    assert all(job.wait(60) for job in started)


def test_callers_take_turns(jobs: Jobs) -> None:
    gate, ran = Gate(), list[str]()
    with asked_by("a"):
        jobs.start("build", "at work", gate)
        assert gate.entered.wait(60)
    started = []
    for name, number in (("a", 1), ("a", 2), ("b", 1), ("c", 1)):
        with asked_by(name):
            one = f"{name}{number}"
            started.append(jobs.start("build", one, lambda job, one=one: ran.append(one)))
    gate.free.set()
    assert all(job.wait(60) for job in started)
    assert ran == ["b1", "c1", "a1", "a2"]


def test_what_a_job_starts_is_its_callers(jobs: Jobs) -> None:
    children: list[Job] = []
    with asked_by("someone"):
        parent = jobs.start(
            "build", "a", lambda job: children.append(jobs.start("bins", "a", nothing))
        )
    assert parent.wait(60)
    assert [child.caller for child in children] == ["someone"]
    assert children[0].wait(60)


def test_a_job_that_waits_ends_at_once_when_it_is_cancelled(jobs: Jobs, gate: Gate) -> None:
    """Though the thread that would find that out is busy."""
    waiting = jobs.start("build", "a", nothing)
    assert jobs.cancel(waiting.info.id).state == "cancelled"
    assert not gate.free.is_set()


def test_a_build_that_takes_too_long_fails_and_says_so() -> None:
    jobs, began = Jobs(MOST, build_seconds=0.05), time.monotonic()

    def long(job: Job) -> None:
        while time.monotonic() < began + 60:
            time.sleep(0.01)
            cancellation.check()

    build = jobs.start("build", "a", long)
    assert build.wait(60)
    assert build.info.state == "failed"
    assert "took longer than 0.05 s" in build.info.detail
    assert "RHYTID_BUILD_SECONDS" in build.info.detail
    jobs.close()
