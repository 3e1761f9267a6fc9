"""Waiting: by events, by asking again where there are none, and never past the time given."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

import httpx
import pytest

from clients.shells import Clock, Shell, problem
from rhytid_client import Asset, BadAnswer, Job, JobCancelled, JobFailed, NotFound, Timeout

ASSET = Asset("a", "building", job="j")
RUNNING = Job("j", "running")
EVENTS = {"Content-Type": "text/event-stream"}
REFUSED = None
COMMENTS = b": only comments\n\n"


def at(progress: float, state: str = "running", detail: str = "") -> dict[str, Any]:
    return {"id": "j", "state": state, "progress": progress, "detail": detail, "asset": "a"}


def event(name: str, job: dict[str, Any]) -> bytes:
    return f": hello\n\nevent: {name}\ndata: {json.dumps(job)}\n\n".encode()


class Server:
    """A job in the states of `jobs`, one a look, none = forgotten; one of `streams` a listener."""

    def __init__(self, *jobs: dict[str, Any], asset: str = "ready", reason: str = "") -> None:
        self.jobs = list(jobs)
        self.streams: list[bytes | Exception | httpx.Response | None] = []
        self.asset = {"id": "a", "state": asset, "reason": reason}
        self.seen: list[str] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.seen.append(request.url.path.removeprefix("/api/v1/"))
        if self.seen[-1] == "jobs/j/events":
            return self._stream()
        if self.seen[-1] == "assets/a":
            return httpx.Response(200, json=self.asset)
        if not self.jobs:
            return problem(404)
        return httpx.Response(200, json=self.jobs.pop(0) if len(self.jobs) > 1 else self.jobs[0])

    def _stream(self) -> httpx.Response:
        answer = self.streams.pop(0) if self.streams else REFUSED
        if isinstance(answer, Exception):
            raise answer
        if isinstance(answer, bytes):
            return httpx.Response(200, headers=EVENTS, content=answer)
        return problem(404) if answer is REFUSED else answer


def test_events_are_told_and_the_end_is_believed(shell: Callable[..., Shell], clock: Clock) -> None:
    server = Server(at(0.0, "queued"), at(1.0, "done"))
    end = event("end", at(1.0, "done"))
    server.streams = [event("progress", at(0.25)) + event("progress", at(0.5)) + end]
    told: list[Job] = []
    assert shell(server).wait(RUNNING, progress=told.append).state == "done"
    assert [job.progress for job in told] == [0.0, 0.25, 0.5, 1.0]
    assert server.seen == ["jobs/j", "jobs/j/events", "jobs/j"]
    assert clock.pauses == []


@pytest.mark.parametrize(
    "stream", [REFUSED, httpx.ReadError("cut"), httpx.ReadTimeout("silent"), b"", COMMENTS]
)
def test_asks_again_where_there_are_no_events(
    shell: Callable[..., Shell], clock: Clock, stream: Any
) -> None:
    server = Server(at(0.1), at(0.1), at(0.6), at(1.0, "done"))
    server.streams = [stream]
    told: list[Job] = []
    assert shell(server).wait(RUNNING, progress=told.append).state == "done"
    assert [job.progress for job in told] == [0.1, 0.6, 1.0]
    assert server.seen == ["jobs/j", "jobs/j/events", "jobs/j", "jobs/j", "jobs/j"]
    assert len(clock.pauses) == 3


def test_broken_stream_is_taken_up_again(shell: Callable[..., Shell], clock: Clock) -> None:
    server = Server(at(0.1), at(0.2), at(1.0, "done"))
    server.streams = [event("progress", at(0.15)), event("end", at(1.0, "done"))]
    told: list[Job] = []
    shell(server).wait(RUNNING, progress=told.append)
    assert [job.progress for job in told] == [0.1, 0.15, 0.2, 1.0]
    assert server.seen.count("jobs/j/events") == 2


def test_failed_job(shell: Callable[..., Shell]) -> None:
    server = Server(at(0.3, "failed", "too many wrinkles"))
    with pytest.raises(JobFailed, match="too many wrinkles") as failed:
        shell(server).wait(RUNNING)
    assert failed.value.job is not None
    assert failed.value.job.progress == 0.3


def test_cancelled_job(shell: Callable[..., Shell]) -> None:
    with pytest.raises(JobCancelled, match="job j was cancelled"):
        shell(Server(at(0.3, "cancelled"))).wait(ASSET)


def test_time_is_over(shell: Callable[..., Shell], clock: Clock) -> None:
    with pytest.raises(Timeout, match="not done in 2 seconds") as late:
        shell(Server(at(0.3))).wait(RUNNING, timeout=2)
    assert sum(clock.pauses) == 2.0
    assert late.value.job is not None
    assert late.value.job.progress == 0.3


class Endless(httpx.SyncByteStream, httpx.AsyncByteStream):
    """One event a second, for longer than any test waits."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def __iter__(self) -> Iterator[bytes]:
        for second in range(100):
            self._clock.now += 1
            yield event("progress", at(second / 100))

    async def __aiter__(self) -> AsyncIterator[bytes]:
        for chunk in self:
            yield chunk


def test_time_is_over_while_events_come(shell: Callable[..., Shell], clock: Clock) -> None:
    server = Server(at(0.0))
    server.streams = [httpx.Response(200, headers=EVENTS, stream=Endless(clock))]
    with pytest.raises(Timeout):
        shell(server).wait(RUNNING, timeout=5)
    assert clock.now == 1005


def test_asset_is_awaited_through_its_job(shell: Callable[..., Shell]) -> None:
    server = Server(at(0.0), at(1.0, "done"))
    server.streams = [event("end", at(1.0, "done"))]
    assert shell(server).wait(ASSET).state == "ready"
    assert server.seen[-1] == "assets/a"


@pytest.mark.parametrize(("kind", "looks"), [("frames", 3), ("calibrate", 1)])
def test_frames_of_an_asset_that_is_known_are_awaited(
    shell: Callable[..., Shell], kind: str, looks: int
) -> None:
    """It is ready at once where a mesh is sent again; its frames are stored by a job."""
    states = ("queued", "running", "done")
    server = Server(*({**at(0.5, state), "kind": kind} for state in states))
    assert shell(server).wait(Asset("a", "ready", job="j")).state == "ready"
    assert server.seen.count("jobs/j") == looks
    assert server.seen[-1] == "assets/a"


def test_frames_that_failed_before_are_no_matter(shell: Callable[..., Shell]) -> None:
    server = Server({**at(0.5, "failed"), "kind": "frames"})
    assert shell(server).wait(Asset("a", "ready", job="j")).state == "ready"


def test_asset_whose_job_is_forgotten(shell: Callable[..., Shell]) -> None:
    assert shell(Server()).wait(ASSET).state == "ready"
    with pytest.raises(NotFound):
        shell(Server()).wait(RUNNING)


def test_asset_that_failed(shell: Callable[..., Shell]) -> None:
    with pytest.raises(JobFailed, match="no graph"):
        shell(Server(asset="failed", reason="no graph")).wait(Asset("a", "failed"))


def test_asset_that_never_ends(shell: Callable[..., Shell], clock: Clock) -> None:
    with pytest.raises(Timeout):
        shell(Server(asset="building")).wait(ASSET, timeout=3)
    assert sum(clock.pauses) == 3.0


def test_event_that_is_no_json(shell: Callable[..., Shell]) -> None:
    server = Server(at(0.0))
    server.streams = [b"event: progress\ndata: <html>\n\n"]
    with pytest.raises(BadAnswer, match="an event of a job is not JSON"):
        shell(server).wait(RUNNING)
