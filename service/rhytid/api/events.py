"""A job as server-sent events: `progress` at every change, then one `end`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import asdict, replace

from starlette.concurrency import run_in_threadpool

from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import NotFoundError

EVENT_STREAM = "text/event-stream"
POLL_SECONDS = 0.1
# A comment now and then keeps proxies from closing a quiet stream.
POLLS_PER_COMMENT = 150


def event(name: str, job: JobInfo) -> bytes:
    """One server-sent event with the job as JSON."""
    return f"event: {name}\ndata: {json.dumps(asdict(job))}\n\n".encode()


async def job_events(
    job: JobInfo,
    poll: Callable[[str], JobInfo],
    over: Callable[[], Awaitable[bool]],
) -> AsyncIterator[bytes]:
    """`progress` at once and after every change, then `end`; nothing once the stream is over:
    the client is gone, or the server ends.

    `poll` may block: it runs in the thread pool.
    """
    yield event("progress", job)
    quiet = 0
    while job.state not in ENDED_STATES:
        await asyncio.sleep(POLL_SECONDS)
        if await over():
            return
        before, job = job, await run_in_threadpool(_poll, poll, job)
        quiet = 0 if job != before else quiet + 1
        if job != before:
            yield event("progress", job)
        elif quiet % POLLS_PER_COMMENT == 0:
            yield b": still at it\n\n"
    yield event("end", job)


def _poll(poll: Callable[[str], JobInfo], job: JobInfo) -> JobInfo:
    """The job now; one that was removed with its asset counts as cancelled."""
    try:
        return poll(job.id)
    except NotFoundError as error:
        return replace(job, state="cancelled", detail=str(error))
