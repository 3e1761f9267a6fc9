"""A job as server-sent events: `progress` at every change, then one `end`."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, replace

import anyio
import anyio.to_thread
from anyio import CapacityLimiter
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from rhytid.api.admission import CallerPlaces
from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import NotFoundError, RhytidError

EVENT_STREAM = "text/event-stream"
# Listeners to all jobs at once, in all and of one caller.
MOST, MOST_EACH = 512, 256
# Seconds between two looks at a job, and threads that look at jobs.
POLL_SECONDS, LOOKING = 0.1, 4
# Seconds after which a quiet stream gets a comment: it keeps proxies from closing it.
QUIET_SECONDS = 15.0
logger = logging.getLogger(__name__)


def event(name: str, job: JobInfo) -> bytes:
    """One server-sent event with the job as JSON."""
    return f"event: {name}\ndata: {json.dumps(asdict(job))}\n\n".encode()


class _Watched:
    """A job that is listened to.  over: whether nobody looks at it any more."""

    def __init__(self, job: JobInfo) -> None:
        self.job, self.over, self.listeners = job, False, 0
        # Made once for all who listen.
        self.progress = event("progress", job)
        self._changed = asyncio.Event()
        self.looking: asyncio.Task[None] | None = None

    @property
    def ended(self) -> bool:
        return self.job.state in ENDED_STATES

    def tell(self, job: JobInfo) -> None:
        """The job as it is now; who listens wakes where it has changed."""
        if job != self.job:
            self.job, self.progress = job, event("progress", job)
            self.wake()

    def wake(self) -> None:
        """Wake all who listen."""
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def change(self, seen: JobInfo) -> bool:
        """Wait until the job is not as it was seen, or over; False where that takes too long."""
        if self.job != seen or self.over:
            return True
        with anyio.move_on_after(QUIET_SECONDS):
            await self._changed.wait()
            return True
        return False


class JobEvents:
    """Who listens to jobs: each job is looked at once in POLL_SECONDS, however many listen to it.

    look: finds a job; it may block.  ends: whether the server does. For one thread.
    """

    def __init__(
        self,
        look: Callable[[str], JobInfo],
        ends: Callable[[], bool],
        most: int = MOST,
        most_each: int = MOST_EACH,
    ) -> None:
        self._look, self._ends = look, ends
        self._places = CallerPlaces(
            most,
            most_each,
            "{count} clients listen to jobs already",
            "{caller} listens to jobs {count} times already",
        )
        self._watched: dict[str, _Watched] = {}
        self._limiter: CapacityLimiter | None = None

    def __len__(self) -> int:
        return len(self._places)

    def place(self, caller: str) -> AbstractContextManager[None]:
        """A place among the listeners within the block; raises QuotaError and BusyError naming the
        limit."""
        return self._places.one(caller)

    async def find(self, id: str) -> JobInfo:
        """A job, as it was seen last where somebody listens to it; raises NotFoundError."""
        watched = self._watched.get(id)
        return await run_in_threadpool(self._look, id) if watched is None else watched.job

    async def of(self, job: JobInfo) -> AsyncIterator[bytes]:
        """`progress` at once and after every change, then `end`; nothing more once the server ends,
        and where the job cannot be looked at."""
        with self._watching(job) as watched:
            seen: JobInfo | None = None
            while watched.job != seen or not (watched.ended or watched.over):
                if watched.job != seen:
                    seen = watched.job
                    yield watched.progress
                elif not await watched.change(seen):
                    yield b": still at it\n\n"
            if watched.ended:
                yield event("end", watched.job)

    @contextmanager
    def _watching(self, job: JobInfo) -> Iterator[_Watched]:
        watched = self._watched.get(job.id)
        if watched is None or watched.over:
            watched = self._watched[job.id] = _Watched(job)
            watched.looking = asyncio.ensure_future(self._keep_looking(watched))
        watched.listeners += 1
        try:
            yield watched
        finally:
            watched.listeners -= 1
            if not watched.listeners:
                self._leave(watched)

    def _leave(self, watched: _Watched) -> None:
        if self._watched.get(watched.job.id) is watched:
            del self._watched[watched.job.id]
        if watched.looking is not None:
            watched.looking.cancel()

    async def _keep_looking(self, watched: _Watched) -> None:
        """Until the job or the server ends, or nobody listens any more."""
        try:
            while not (watched.ended or self._ends()):
                await asyncio.sleep(POLL_SECONDS)
                watched.tell(await self._now(watched.job))
        except Exception:
            logger.exception("job %s cannot be looked at", watched.job.id)
        finally:
            watched.over = True
            watched.wake()

    async def _now(self, job: JobInfo) -> JobInfo:
        self._limiter = self._limiter or CapacityLimiter(LOOKING)
        return await anyio.to_thread.run_sync(_found, self._look, job, limiter=self._limiter)


def _found(look: Callable[[str], JobInfo], job: JobInfo) -> JobInfo:
    """The job now; one that was removed with its asset counts as cancelled, and one that cannot be
    asked for at the moment is as it was."""
    try:
        return look(job.id)
    except NotFoundError as error:
        return replace(job, state="cancelled", detail=str(error))
    except RhytidError as error:
        if getattr(error, "retry_after", None) is None:
            raise
        return job


class EventStream(StreamingResponse):
    """The events of a job, to a caller who takes a place among the listeners meanwhile."""

    def __init__(self, events: JobEvents, job: JobInfo, caller: str) -> None:
        headers = {"Cache-Control": "no-store"}
        super().__init__(events.of(job), media_type=EVENT_STREAM, headers=headers)
        self._events, self._caller = events, caller

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send them until there are no more, or the client is gone; raises as `JobEvents.place`
        does, before anything is sent."""
        with self._events.place(self._caller):
            await super().__call__(scope, receive, send)
