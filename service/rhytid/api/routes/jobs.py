"""Jobs: how far long work is, by asking or by listening."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from rhytid.api.dependencies import EngineDep, JobId, NoQuery
from rhytid.api.documentation import EVENTS, problems
from rhytid.api.draining import Drain
from rhytid.api.events import EVENT_STREAM, job_events
from rhytid.api.schemas import Job

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=[NoQuery])


@router.get("/{job}", operation_id="getJob", response_model=Job, responses=problems(404, 422))
def show(job: JobId, engine: EngineDep) -> Any:
    """A job as it stands."""
    return engine.jobs.info(job)


@router.get(
    "/{job}/events",
    operation_id="streamJobEvents",
    response_class=StreamingResponse,
    responses={**EVENTS, **problems(404, 422)},
)
def events(job: JobId, request: Request, engine: EngineDep) -> StreamingResponse:
    """Server-sent events `progress` while it runs and `end` once; the data is the job as JSON."""
    drain: Drain = request.app.state.drain

    async def over() -> bool:
        return drain.begun or await request.is_disconnected()

    stream = job_events(engine.jobs.info(job), engine.jobs.info, over)
    return StreamingResponse(stream, media_type=EVENT_STREAM, headers={"Cache-Control": "no-store"})


@router.delete("/{job}", operation_id="cancelJob", response_model=Job, responses=problems(404, 422))
def cancel(job: JobId, engine: EngineDep) -> Any:
    """Ask a job to stop; answers with its state."""
    return engine.jobs.cancel(job)
