"""Jobs: the progress of long work, by asking or by listening."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse

from rhytid.api.access import Caller
from rhytid.api.dependencies import EngineDep, JobId, NoQuery
from rhytid.api.documentation import EVENTS, problems
from rhytid.api.events import EventStream, JobEvents
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
    responses={**EVENTS, **problems(404, 422, 503)},
)
async def events(job: JobId, request: Request) -> EventStream:
    """Server-sent events `progress` while it runs and `end` once; the data is the job as JSON.
    Refused where too many listen already: then ask for the job itself."""
    listened: JobEvents = request.app.state.job_events
    found = await listened.find(job)
    return EventStream(listened, found, Caller.of(request.scope).name)


@router.delete("/{job}", operation_id="cancelJob", response_model=Job, responses=problems(404, 422))
def cancel(job: JobId, engine: EngineDep) -> Any:
    """Ask a job to stop; answers with its state."""
    return engine.jobs.cancel(job)
