"""What follows a job: done once, before anybody is told that the job has ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from rhytid.engine.messages import JobInfo
from rhytid.errors import DeviceLostError, NotFoundError
from rhytid.fleet.jobs import JobWatch

RUNNING = JobInfo("1", "a", "build", "running", 0.5, "", "")
DONE = replace(RUNNING, state="done")


class Jobs:
    """Jobs by id, or the errors that are raised for them."""

    def __init__(self) -> None:
        self.known: dict[str, Any] = {}

    def info(self, job: str) -> JobInfo:
        found = self.known[job]
        if isinstance(found, Exception):
            raise found
        return found  # type: ignore[no-any-return]


@pytest.fixture
def jobs() -> Jobs:
    return Jobs()


@pytest.fixture
def watch(jobs: Jobs) -> Iterator[JobWatch]:
    made = JobWatch(jobs.info)
    yield made
    made.close()


def test_what_follows_is_done_in_order_and_once(jobs: Jobs, watch: JobWatch) -> None:
    jobs.known["1"], seen = RUNNING, []
    for number in range(3):
        watch.watch("1", lambda ended, number=number: seen.append((number, ended)))
    time.sleep(0.3)
    assert seen == []
    jobs.known["1"] = DONE
    watch.settle("1")
    time.sleep(0.2)
    assert seen == [(number, DONE) for number in range(3)]


def test_who_asks_waits_for_what_follows(jobs: Jobs, watch: JobWatch) -> None:
    jobs.known["1"], going = DONE, threading.Event()
    watch.watch("1", lambda ended: going.wait(10))
    waiting = threading.Thread(target=watch.settle, args=("1",))
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive()
    going.set()
    waiting.join(10)
    assert not waiting.is_alive()
    watch.settle("of nobody")


def test_a_job_that_is_not_known_ends_and_one_that_cannot_be_asked_for_does_not(
    jobs: Jobs, watch: JobWatch
) -> None:
    jobs.known = {"1": NotFoundError("no job 1"), "2": DeviceLostError("it restarts")}
    seen: list[tuple[str, JobInfo | None]] = []
    watch.watch("1", lambda ended: seen.append(("1", ended)))
    watch.watch("2", lambda ended: seen.append(("2", ended)))
    watch.settle("1")
    assert seen == [("1", None)]
    jobs.known["2"] = DONE
    watch.settle("2")
    assert seen[1] == ("2", DONE)


def test_an_error_of_what_follows_keeps_no_other_job(jobs: Jobs, watch: JobWatch) -> None:
    jobs.known, seen = {"1": DONE, "2": DONE}, []

    def fail(ended: JobInfo | None) -> None:
        raise OSError("no room")

    watch.watch("1", fail)
    watch.watch("2", seen.append)
    watch.settle("1")
    watch.settle("2")
    assert seen == [DONE]
