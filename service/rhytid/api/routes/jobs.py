"""Jobs: how far long work is, by asking or by listening."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from rhytid.api.dependencies import EngineDep, NoQuery
from rhytid.api.documentation import binary, problems
from rhytid.api.events import job_events
from rhytid.api.schemas import Job

EVENT_STREAM = "text/event-stream"
router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=[NoQuery])


@router.get("/{job}", response_model=Job, responses=problems(404, 422))
def show(job: str, engine: EngineDep) -> Any:
    """A job as it stands."""
    return engine.jobs.info(job)


@router.get(
    "/{job}/events",
    response_class=StreamingResponse,
    responses={**binary(EVENT_STREAM), **problems(404, 422)},
)
def events(job: str, request: Request, engine: EngineDep) -> StreamingResponse:
    """Server-sent events `progress` while it runs and `end` once; the data is the job as JSON."""
    stream = job_events(engine.jobs.info(job), engine.jobs.info, request.is_disconnected)
    return StreamingResponse(stream, media_type=EVENT_STREAM, headers={"Cache-Control": "no-store"})


@router.delete("/{job}", response_model=Job, responses=problems(404, 422))
def cancel(job: str, engine: EngineDep) -> Any:
    """Ask a job to stop; answers with its state."""
    return engine.jobs.cancel(job)
