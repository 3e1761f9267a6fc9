"""Jobs: asking, cancelling, and waiting by events with asking again as the fallback."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from typing import TypeVar

from rhytid_client import parse
from rhytid_client.calls.asset_calls import asset
from rhytid_client.errors import BadAnswer, JobCancelled, JobFailed, NotFound, Timeout
from rhytid_client.events import EventReader
from rhytid_client.exchange import Flow, Listen, Pause
from rhytid_client.requests import get, request
from rhytid_client.results import Asset, Job

W = TypeVar("W", Asset, Job)
Progress = Callable[[Job], None]

POLL_SECONDS = 0.5
# The server breaks a silence with a comment well before this.
SILENCE_SECONDS = 30.0


def job(job: Job | str) -> Flow[Job]:
    """A job as it is now."""
    return parse.one(Job, (yield get("v1", "jobs", _id(job))))


def cancel(job: Job | str) -> Flow[Job]:
    """Ask a job to stop; answers with its state."""
    return parse.one(Job, (yield request("DELETE", "v1", "jobs", _id(job))))


def wait(what: W, *, progress: Progress | None = None, timeout: float | None = None) -> Flow[W]:
    """Wait until a job has ended, or an asset is built and the frames of a mesh file that was sent
    again are stored, and return it as it is then.

    progress: called with the job each time it has moved.  timeout: seconds; None = for ever.
    Raises JobFailed, JobCancelled or Timeout.
    """
    watch = _Watch(progress, timeout)
    if isinstance(what, Asset):
        return (yield from _built(what, watch))
    return (yield from _ended(what.id, watch))


class _Watch:
    """What waiting remembers: the time left, and the last job that was shown."""

    def __init__(self, progress: Progress | None, timeout: float | None) -> None:
        self._progress = progress
        self._timeout = timeout
        self._end = float("inf") if timeout is None else monotonic() + timeout
        self._last: Job | None = None

    def tell(self, job: Job) -> None:
        if job != self._last and self._progress is not None:
            self._progress(job)
        self._last = job

    def left(self, most: float) -> float:
        """Seconds left, at most `most`; raises Timeout where none are."""
        left = self._end - monotonic()
        if left <= 0:
            raise Timeout(f"not done in {self._timeout:g} seconds", self._last)
        return min(left, most)


class _Ear:
    """Reads the events of one stream; `done` once the last one came."""

    def __init__(self, watch: _Watch) -> None:
        self._watch = watch
        self._reader = EventReader()
        self.heard = False
        self.done = False

    def feed(self, chunk: bytes) -> bool:
        """Tell the jobs in `chunk`; true where there is no more to hear, or no more time."""
        for event in self._reader.feed(chunk):
            self.heard = True
            self.done = event.name == "end"
            if event.name in ("progress", "end"):
                self._watch.tell(_job_in(event.data))
        self._watch.left(0.0)
        return self.done


def _job_in(data: str) -> Job:
    try:
        return parse.read(Job, json.loads(data))
    except (ValueError, RecursionError) as exc:
        raise BadAnswer(f"an event of a job is not JSON: {exc}") from exc


def _ended(id: str, watch: _Watch) -> Flow[Job]:
    listening = True
    while True:
        now = yield from job(id)
        watch.tell(now)
        if now.ended:
            return _done(now)
        if listening:
            ear = _Ear(watch)
            yield Listen(get("v1", "jobs", id, "events"), ear.feed, watch.left(SILENCE_SECONDS))
            listening = ear.heard
            if ear.done:
                continue
        yield Pause(watch.left(POLL_SECONDS))


def _done(job: Job) -> Job:
    if job.state == "failed":
        raise JobFailed(job.detail or f"job {job.id} failed", job)
    if job.state == "cancelled":
        raise JobCancelled(f"job {job.id} was cancelled", job)
    return job


def _built(wanted: Asset, watch: _Watch) -> Flow[Asset]:
    if wanted.state == "building" and wanted.job is not None:
        # Jobs do not survive a restart of the server; the asset does, and knows its state.
        with suppress(NotFound):
            yield from _ended(wanted.job, watch)
    elif wanted.state == "ready" and wanted.job is not None:
        with suppress(NotFound):
            yield from _stored(wanted.job, watch)
    while True:
        now = yield from asset(wanted.id)
        if now.state == "failed":
            raise JobFailed(now.reason or f"asset {now.id} could not be built")
        if now.state != "building":
            return now
        yield Pause(watch.left(POLL_SECONDS))


def _stored(id: str, watch: _Watch) -> Flow[None]:
    """Wait for a job that stores the frames of a file; not for others of an asset, nor for what has
    become of one that ended before."""
    now = yield from job(id)
    if now.kind == "frames" and not now.ended:
        yield from _ended(id, watch)


def _id(job: Job | str) -> str:
    return job.id if isinstance(job, Job) else job
