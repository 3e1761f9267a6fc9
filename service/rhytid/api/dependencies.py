"""What routes ask for by annotation: the engine, a body, a path number."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from fastapi import Depends, Path, Query, Request
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from rhytid.api import uploads
from rhytid.api.access import Caller
from rhytid.api.admission import ClientGone, JobShare
from rhytid.api.encoded_tiles import EncodedTiles
from rhytid.api.former_frames import FormerNames
from rhytid.api.metrics import Metrics
from rhytid.api.multipart import Part
from rhytid.api.request_memory import RequestMemory
from rhytid.api.schemas import ALLOW, CODE, STRICT
from rhytid.api.spool import Spool
from rhytid.api.written_files import WrittenFiles
from rhytid.device.figures import Figures
from rhytid.errors import QueryError
from rhytid.formats.frames import read_positions
from rhytid.processes.decoding.decoder import Decoder

if TYPE_CHECKING:
    from rhytid.engine.operations import Engine
else:
    # FastAPI resolves annotations at run time; the transport loads no OpenCL for a name.
    Engine = object


AssetId = Annotated[str, Path(description="id of an asset")]


# Dependencies are coroutines where they do not block: a plain function costs a hop to a thread.
async def _engine(request: Request) -> Any:
    return request.app.state.engine


EngineDep = Annotated[Engine, Depends(_engine)]


async def _slot(request: Request) -> Any:
    return request.app.state.slots.one(ClientGone(request))


async def _former(request: Request) -> Any:
    return request.app.state.former_names


async def _gone(request: Request) -> Any:
    return ClientGone(request)


async def _decoder(request: Request) -> Any:
    return request.app.state.decoder


async def _memory(request: Request) -> RequestMemory:
    return RequestMemory.of(request)


async def _files(request: Request) -> Any:
    return request.app.state.files


# Not async: it may ask the device's process, which the event loop must not wait for.
def _job_share(request: Request) -> Iterator[JobShare]:
    with request.app.state.job_shares.one(Caller.of(request.scope)) as share:
        yield share


async def _job_places(request: Request) -> Any:
    return partial(request.app.state.job_shares.one, Caller.of(request.scope))


async def _metrics(request: Request) -> Any:
    return request.app.state.metrics


@dataclass(frozen=True)
class Drawing:
    """What a request for a tile or a map works with. One dependency in place of four: solving one
    takes about as long as parsing the head of a request."""

    engine: Engine
    metrics: Metrics
    slot: AbstractContextManager[None]
    memory: RequestMemory
    encoded: EncodedTiles


async def drawing_of(request: Request) -> Drawing:
    """What a request for a tile or a map works with."""
    state = request.app.state
    slot = state.slots.one(ClientGone(request))
    memory = RequestMemory.of(request)
    return Drawing(state.engine, state.metrics, slot, memory, state.encoded())


async def no_query(request: Request) -> None:
    """Refuse every query parameter that the route does not declare; raises QueryError naming the
    first."""
    known = [parameter.alias for parameter in request.scope["route"].dependant.query_params]
    for name in request.query_params:
        if name not in known:
            here = ", ".join(known) or "none"
            raise QueryError(f"unknown query parameter {name!r}: {here} is known here")
    await no_repeats(request)


# Query parameters that are lists.
REPEATED = ("tile", "allow")


async def no_repeats(request: Request) -> None:
    """Refuse a query parameter sent twice that may not be; raises QueryError naming it."""
    for name in request.query_params:
        if name not in REPEATED and len(request.query_params.getlist(name)) > 1:
            raise QueryError(f"query parameter {name!r} was sent more than once")


def _positions(what: str) -> Callable[..., Awaitable[NDArray[np.float32]]]:
    """Reads the body as positions (V, 3) of an asset, less its centre.

    what: words for them in errors, with parameters of the path in braces. What is returned raises
    FrameError with these words, or LimitError, and NotFoundError where there is no such asset.
    """

    async def read(request: Request, asset: AssetId, engine: EngineDep) -> NDArray[np.float32]:
        # The asset comes first: it says how much of a body is worth reading.
        found = await run_in_threadpool(engine.assets.dimensions, asset)
        figures: Figures = request.app.state.metrics.figures
        with figures.stage("upload"):
            body = await uploads.read_frame(request, found.vertices)
        media_type, words = uploads.media_type_of(request), what.format(**request.path_params)
        sent = body, media_type, found.vertices, np.array(found.centre), words
        with figures.stage("decode"):
            return await run_in_threadpool(read_positions, *sent)

    return read


def _uploaded(read: Callable[[Request], Awaitable[Any]]) -> Callable[[Request], Awaitable[Any]]:
    """Reads a body, which is timed."""

    async def timed(request: Request) -> Any:
        with request.app.state.metrics.figures.stage("upload"):
            return await read(request)

    return timed


# Positions of a frame that is drawn and not stored.
drawn_positions_of = _positions("frame")
# The body as positions of the asset in the path: of the frame in the path, of the one that bins are
# for, and of one that is drawn and not stored.
FramePositions = Annotated[NDArray[np.float32], Depends(_positions("frame {frame!r:.80}"))]
CalibrationPositions = Annotated[NDArray[np.float32], Depends(_positions("calibration frame"))]
DrawnPositions = Annotated[NDArray[np.float32], Depends(drawn_positions_of)]
NoQuery = Depends(no_query)
NoRepeats = Depends(no_repeats)
# Held by `with` for as long as a request waits for the device; raises BusyError on entry. What is
# drawn meanwhile stops where the client is gone.
Slot = Annotated[AbstractContextManager[None], Depends(_slot)]
# Whether the client has closed the connection, for a thread to ask once the body has been read.
Gone = Annotated[Callable[[], bool], Depends(_gone)]
# Which assets have frames that had other names in earlier versions.
FormerDep = Annotated[FormerNames, Depends(_former)]
DecoderDep = Annotated[Decoder, Depends(_decoder)]
# What the request holds of the host's memory until its answer is sent.
Memory = Annotated[RequestMemory, Depends(_memory)]
Files = Annotated[WrittenFiles, Depends(_files)]
# A place among the unfinished jobs of the caller. It comes before the body in a signature, so that
# who has too many is refused before it is read; raises QuotaError.
JobPlace = Annotated[JobShare, Depends(_job_share)]
# The same for a route that finds out by itself whether it needs one.
JobPlaces = Annotated[Callable[[], AbstractContextManager[JobShare]], Depends(_job_places)]
DrawingDep = Annotated[Drawing, Depends(drawing_of)]
MetricsDep = Annotated[Metrics, Depends(_metrics)]
Strict = Annotated[bool, Query(description=STRICT)]
Shared = Annotated[bool, Query(description="remove it from the shared store, too")]
Allow = Annotated[
    list[str],
    Query(default_factory=list, description=ALLOW, json_schema_extra={"items": CODE}),
]
Json = Annotated[Any, Depends(uploads.read_json)]
Parts = Annotated[dict[str, Part], Depends(_uploaded(uploads.read_parts))]
SnapshotBody = Annotated[Spool, Depends(_uploaded(uploads.read_snapshot))]
FrameName = Annotated[str, Path(description="name of a frame; `neutral` is always there")]
JobId = Annotated[str, Path(description="id of a job")]
_MOST = 2**31
Udim = Annotated[int, Path(ge=0, lt=_MOST, description="UDIM of the map, 1001 for the first")]
Level = Annotated[
    int, Path(ge=0, lt=_MOST, description="0 is the full resolution; every level halves it")
]
Row = Annotated[int, Path(ge=0, lt=_MOST, description="row of the tile, from 0 at the top")]
Column = Annotated[int, Path(ge=0, lt=_MOST, description="column of the tile, from 0 at the left")]
