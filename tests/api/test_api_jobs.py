"""Jobs over HTTP, and their events."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from dataclasses import asdict, replace
from typing import Any

import httpx
import pytest

from api.asking import is_problem
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import upload
from rhytid.api import events
from rhytid.engine.messages import JobInfo
from rhytid.errors import NotFoundError

JOB = JobInfo("j", "a", "build", "running", 0.5, "trails", "")


def read_events(text: str) -> list[tuple[str, dict[str, Any]]]:
    blocks = [b.split("\n") for b in text.split("\n\n") if b and not b.startswith(":")]
    assert all(len(b) == 2 for b in blocks)
    return [(b[0].removeprefix("event: "), json.loads(b[1].removeprefix("data: "))) for b in blocks]


def test_events_follow_a_job_to_its_end() -> None:
    with serving(FakeEngine(polls=4)) as client:
        job = client.post("/v1/assets", files=upload()).json()["job"]
        with client.stream("GET", f"/v1/jobs/{job}/events") as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            found = read_events(stream.read().decode())
        assert [name for name, _ in found] == ["progress"] * 4 + ["end"]
        progress = [data["progress"] for _, data in found]
        assert progress == sorted(progress)
        assert found[-1][1] == client.get(f"/v1/jobs/{job}").json()
        assert found[-1][1]["state"] == "done"


def test_a_job_that_is_over_ends_at_once(client: httpx.Client, asset: str) -> None:
    job = client.get(f"/v1/assets/{asset}").json()["job"]
    found = read_events(client.get(f"/v1/jobs/{job}/events").text)
    assert [name for name, _ in found] == ["progress", "end"]


def test_a_job_can_be_cancelled() -> None:
    with serving(FakeEngine(polls=1000)) as client:
        made = client.post("/v1/assets", files=upload()).json()
        answer = client.delete(f"/v1/jobs/{made['job']}")
        assert (answer.status_code, answer.json()["state"]) == (200, "cancelled")
        found = read_events(client.get(f"/v1/jobs/{made['job']}/events").text)
        assert found[-1][0] == "end"
        assert client.get(f"/v1/assets/{made['id']}").json()["state"] == "failed"


@pytest.mark.parametrize(("method", "call"), [("GET", ""), ("GET", "/events"), ("DELETE", "")])
def test_an_unknown_job_is_404(client: httpx.Client, method: str, call: str) -> None:
    assert "nobody" in is_problem(
        client.request(method, f"/v1/jobs/nobody{call}"), 404, "not-found"
    )


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "POLL_SECONDS", 0)
    monkeypatch.setattr(events, "POLLS_PER_COMMENT", 3)


async def collect(stream: AsyncIterator[bytes]) -> list[bytes]:
    return [chunk async for chunk in stream]


def connected_for(checks: int) -> Any:
    left = iter([False] * checks)

    async def disconnected() -> bool:
        return next(left, True)

    return disconnected


@pytest.mark.usefixtures("quick")
def test_a_client_that_left_ends_the_stream() -> None:
    looks: list[str] = []

    def poll(job: str) -> JobInfo:
        looks.append(job)
        return replace(JOB, detail=str(len(looks)))

    stream = events.job_events(JOB, poll, connected_for(2))
    sent = asyncio.run(collect(stream))
    assert len(looks) == 2
    assert [s.split(b"\n")[0] for s in sent] == [b"event: progress"] * 3


@pytest.mark.usefixtures("quick")
def test_a_quiet_stream_is_kept_open_by_comments() -> None:
    sent = asyncio.run(collect(events.job_events(JOB, lambda job: JOB, connected_for(7))))
    assert sent == [events.event("progress", JOB), *[b": still at it\n\n"] * 2]


@pytest.mark.usefixtures("quick")
def test_a_job_that_goes_with_its_asset_ends() -> None:
    def poll(job: str) -> JobInfo:
        raise NotFoundError(f"no job {job!r}")

    sent = asyncio.run(collect(events.job_events(JOB, poll, connected_for(9))))
    (name, data) = read_events(sent[-1].decode())[0]
    assert name == "end"
    assert data == {**asdict(JOB), "warnings": [], "state": "cancelled", "detail": "no job 'j'"}
