"""Jobs over HTTP, and their events."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import httpx
import pytest

from api.asking import is_problem
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import upload
from rhytid.api import events
from rhytid.engine.messages import JobInfo
from rhytid.errors import BusyError, DeviceLostError, NotFoundError, QuotaError

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
    monkeypatch.setattr(events, "POLL_SECONDS", 0.001)
    monkeypatch.setattr(events, "QUIET_SECONDS", 0.01)


async def collect(stream: AsyncIterator[bytes]) -> list[bytes]:
    return [chunk async for chunk in stream]


def going(*states: str) -> Callable[[str], JobInfo]:
    """Looks at a job, which is in one state after the other."""
    left = iter(states)

    def look(id: str) -> JobInfo:
        state = next(left, states[-1])
        return replace(JOB, id=id, state=state, detail=state)

    return look


@pytest.mark.usefixtures("quick")
def test_each_job_is_looked_at_once_however_many_listen() -> None:
    looks: list[str] = []
    look = going(*(f"step {step}" for step in range(20)), "done")

    def counted(id: str) -> JobInfo:
        looks.append(id)
        return look(id)

    async def listen() -> list[list[bytes]]:
        listened = events.JobEvents(counted, lambda: False)
        return await asyncio.gather(*(collect(listened.of(JOB)) for _ in range(300)))

    found = asyncio.run(listen())
    assert len(looks) == 21
    assert len(found) == 300
    for sent in found:
        states = [json.loads(one.split(b"data: ")[1])["state"] for one in sent if one[:1] != b":"]
        assert (states[0], states[-2:]) == ("running", ["done", "done"])
        assert sent[-1].startswith(b"event: end")
        assert len(states) == len(set(states)) + 1, "each change is told once"


@pytest.mark.usefixtures("quick")
def test_a_job_is_left_alone_once_nobody_listens() -> None:
    looks: list[str] = []

    def look(id: str) -> JobInfo:
        looks.append(id)
        return replace(JOB, detail=str(len(looks)))

    async def leave() -> None:
        listened = events.JobEvents(look, lambda: False)
        one, other = listened.of(JOB), listened.of(JOB)
        for _ in range(3):
            await anext(one)
            await anext(other)
        await one.aclose()  # type: ignore[attr-defined]
        await anext(other)
        await other.aclose()  # type: ignore[attr-defined]
        await asyncio.sleep(0.01)
        before = len(looks)
        await asyncio.sleep(0.05)
        assert len(looks) == before
        assert listened._watched == {}

    asyncio.run(leave())


@pytest.mark.usefixtures("quick")
def test_a_stream_ends_with_the_server() -> None:
    ends = threading.Event()

    async def listen() -> list[bytes]:
        stream = events.JobEvents(lambda id: JOB, ends.is_set).of(JOB)
        sent = [await anext(stream)]
        ends.set()
        return sent + [one for one in await collect(stream) if one.startswith(b"event")]

    assert asyncio.run(listen()) == [events.event("progress", JOB)]


@pytest.mark.usefixtures("quick")
def test_a_quiet_stream_is_kept_open_by_comments() -> None:
    async def listen() -> list[bytes]:
        stream = events.JobEvents(lambda id: JOB, lambda: False).of(JOB)
        sent = [await anext(stream) for _ in range(3)]
        await stream.aclose()  # type: ignore[attr-defined]
        return sent

    assert asyncio.run(listen()) == [events.event("progress", JOB), *[b": still at it\n\n"] * 2]


@pytest.mark.usefixtures("quick")
def test_a_job_that_goes_with_its_asset_ends() -> None:
    def look(job: str) -> JobInfo:
        raise NotFoundError(f"no job {job!r}")

    sent = asyncio.run(collect(events.JobEvents(look, lambda: False).of(JOB)))
    (name, data) = read_events(sent[-1].decode())[0]
    assert name == "end"
    assert data == {**asdict(JOB), "warnings": [], "state": "cancelled", "detail": "no job 'j'"}


@pytest.mark.usefixtures("quick")
def test_a_stream_outlives_a_device_that_restarts() -> None:
    answers = iter([DeviceLostError("it restarts"), BusyError("full"), replace(JOB, state="done")])

    def look(job: str) -> JobInfo:
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    sent = asyncio.run(collect(events.JobEvents(look, lambda: False).of(JOB)))
    assert [one.split(b"\n")[0] for one in sent if one.startswith(b"event")] == [
        b"event: progress", b"event: progress", b"event: end",
    ]  # fmt: skip


@pytest.mark.usefixtures("quick")
def test_a_look_that_fails_ends_the_stream_and_no_other(caplog: pytest.LogCaptureFixture) -> None:
    def look(job: str) -> JobInfo:
        raise ZeroDivisionError

    async def listen() -> None:
        listened = events.JobEvents(look, lambda: False)
        for _ in range(2):
            told = [one for one in await collect(listened.of(JOB)) if one.startswith(b"event")]
            assert told == [events.event("progress", JOB)]

    asyncio.run(listen())
    assert caplog.text.count("job j cannot be looked at") == 2


def test_listeners_are_counted_by_caller_and_in_all() -> None:
    listened = events.JobEvents(lambda id: JOB, lambda: False, most=3, most_each=2)
    with listened.place("one"), listened.place("one"):
        with pytest.raises(QuotaError, match=r"^one listens to jobs 2 times already$"):
            listened.place("one").__enter__()
        with listened.place("other"):
            assert len(listened) == 3
            with pytest.raises(BusyError, match="3 clients listen to jobs already"):
                listened.place("third").__enter__()
        with listened.place("third"):
            pass
    assert len(listened) == 0


def test_one_listener_too_many_is_refused_and_places_come_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rhytid.api.app.JobEvents", partial(events.JobEvents, most=2))
    with serving(FakeEngine(polls=10**9)) as client:
        job = client.post("/v1/assets", files=upload()).json()["job"]
        path = f"/v1/jobs/{job}/events"
        with client.stream("GET", path) as one, client.stream("GET", path) as other:
            assert (one.status_code, other.status_code) == (200, 200)
            answer = client.get(path)
            assert "2 clients" in is_problem(answer, 503, "busy")
            assert int(answer.headers["Retry-After"]) > 0
            assert client.get(f"/v1/jobs/{job}").status_code == 200
        for _ in range(6000):
            with client.stream("GET", path) as again:
                if again.status_code == 200:
                    break
        assert again.status_code == 200
        client.delete(f"/v1/jobs/{job}")
