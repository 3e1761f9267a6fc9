"""The queue of jobs: its bound, its order, small jobs beside large ones."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from rhytid.engine.jobs import Job, Jobs
from rhytid.errors import BusyError, CancelledError

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
