"""The HTTP application: routes over an engine. Nothing is built when this is imported."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

from fastapi import Depends, FastAPI
from fastapi.routing import APIRoute
from starlette.datastructures import State
from starlette.middleware.cors import CORSMiddleware

from rhytid import __version__
from rhytid.api import problems
from rhytid.api.accept import PlainBytes
from rhytid.api.access import Access, guard
from rhytid.api.admission import (
    MOST_LIVE,
    DeviceSlots,
    JobShares,
    LargeAnswers,
    LivePlaces,
    threads,
)
from rhytid.api.documentation import describe
from rhytid.api.draining import Drain, Draining
from rhytid.api.encoded_tiles import EncodedTiles
from rhytid.api.encoding import SCALE, WARNINGS
from rhytid.api.events import JobEvents
from rhytid.api.former_frames import NOTICE, FormerFrames, FormerNames
from rhytid.api.metrics import Metrics, Observe
from rhytid.api.request_head import HEADER, CheckHead, RequestIds
from rhytid.api.request_memory import HoldUntilSent, small_budget
from rhytid.api.routes import (
    asset_files,
    assets,
    bins,
    frames,
    health,
    jobs,
    live,
    packages,
    pages,
    tiles,
)
from rhytid.api.routes.packages import KEY
from rhytid.api.tracing import tracer
from rhytid.api.written_files import WrittenFiles
from rhytid.engine.byte_budget import ByteBudget
from rhytid.processes.decoding.decoder import Decoder
from rhytid.support.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.engine.operations import Engine

# Looked through in this order for each request: what is asked for most comes first.
ROUTERS = (
    tiles.tile_router,
    tiles.router,
    tiles.tiles_router,
    assets.router,
    asset_files.router,
    packages.router,
    frames.router,
    live.router,
    bins.router,
    jobs.router,
    health.router,
    pages.router,
)

# What web pages of allowed origins may send and read. No cookies: keys are in a header.
SHARED: dict[str, Any] = {
    "allow_methods": ("GET", "HEAD", "PUT", "POST", "PATCH", "DELETE"),
    "allow_headers": (
        "Authorization",
        "Content-Type",
        "If-None-Match",
        "If-Range",
        "Range",
        HEADER,
    ),
    "expose_headers": (
        *("Accept-Ranges", "Content-Range", "ETag", "Location", "Retry-After"),
        *(HEADER, KEY, NOTICE, SCALE, WARNINGS),
    ),
    "max_age": 600,
}


def create_app(engine: Engine, settings: ServiceSettings) -> FastAPI:
    """An application over `engine`, which stays the caller's to close."""
    app = FastAPI(
        title="rhytid",
        version=__version__,
        redirect_slashes=False,
        lifespan=threads,
        dependencies=[Depends(guard)],
        # `routes.pages` has pages that need no internet.
        docs_url=None,
        redoc_url=None,
        # `Observe` makes the span of each request. Those that new versions of FastAPI make would be
        # traces beside it, with the query; older versions keep this among what they do not know.
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    _place_parts(app.state, engine, settings)
    every = (route for router in ROUTERS for route in router.routes)
    app.state.routes = [route for route in every if isinstance(route, APIRoute)]
    for router in ROUTERS:
        app.include_router(router)
    _add_layers(app, settings)
    problems.install(app)
    app.openapi = partial(describe, app)  # type: ignore[method-assign]
    return app


def _place_parts(state: State, engine: Engine, settings: ServiceSettings) -> None:
    """What routes share, each made once per application."""
    state.engine = engine
    state.settings = settings
    state.access = Access(settings)
    state.job_shares = JobShares(lambda job: engine.jobs.info(job))
    state.slots = DeviceSlots(settings.queue)
    # One for each connection, which draws one tile at a time: others leave them theirs.
    state.live_slots = DeviceSlots(MOST_LIVE)
    state.readiness = health.Readiness(lambda: engine.ready())
    state.drain = Drain(settings.drain_seconds)
    state.job_events = JobEvents(lambda job: engine.jobs.info(job), lambda: state.drain.begun)
    state.decoder = Decoder()
    state.large = LargeAnswers()
    state.live_places = LivePlaces()
    state.small = cache(lambda: small_budget(engine.memory))
    state.encoded = cache(lambda: EncodedTiles(state.small()))
    state.former_names = FormerNames()
    state.spool = ByteBudget(settings.spool, "RHYTID_SPOOL_MB")
    state.files = WrittenFiles(state.spool, settings.store / "partial")
    state.metrics = Metrics(
        engine,
        {
            "host": lambda: engine.memory,
            "small": state.small,
            "spool": lambda: state.spool,
        },
        state.drain,
        state.live_places,
    )


def _add_layers(app: FastAPI, settings: ServiceSettings) -> None:
    """Each layer is around those that were added before it."""
    app.add_middleware(FormerFrames, names=app.state.former_names)
    if settings.origins:
        app.add_middleware(CORSMiddleware, allow_origins=settings.origins, **SHARED)
    app.add_middleware(PlainBytes)
    app.add_middleware(CheckHead, hosts=settings.hosts, origins=settings.origins)
    app.add_middleware(Draining, drain=app.state.drain)
    app.add_middleware(
        Observe,
        metrics=app.state.metrics,
        tracer=tracer(),
        trace_kernels=settings.trace_kernels,
    )
    app.add_middleware(RequestIds)
    app.add_middleware(HoldUntilSent)
