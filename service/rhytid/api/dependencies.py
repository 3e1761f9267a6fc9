"""What routes ask for by annotation: the engine, a body, a path number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from fastapi import Depends, Path, Request
from numpy.typing import NDArray

from rhytid.api import uploads
from rhytid.api.metrics import Metrics
from rhytid.api.parts import Part
from rhytid.errors import QueryError
from rhytid.formats.frames import read_positions

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
else:
    # FastAPI resolves annotations at run time; the transport loads no OpenCL for a name.
    Engine = object


def _engine(request: Request) -> Any:
    return request.app.state.engine


EngineDep = Annotated[Engine, Depends(_engine)]
Body = Annotated[bytes, Depends(uploads.read_body)]


def _metrics(request: Request) -> Any:
    return request.app.state.metrics


def no_query(request: Request) -> None:
    """Refuse every query parameter; raises QueryError naming the first."""
    for name in request.query_params:
        raise QueryError(f"unknown query parameter {name!r}: none is known here")


def no_repeats(request: Request) -> None:
    """Refuse a query parameter sent twice (`tile` may be); raises QueryError naming it."""
    for name in request.query_params:
        if name != "tile" and len(request.query_params.getlist(name)) > 1:
            raise QueryError(f"query parameter {name!r} was sent more than once")


def _positions(request: Request, body: Body, asset: str, engine: EngineDep) -> NDArray[np.float32]:
    return read_positions(body, uploads.media_type_of(request), engine.asset(asset).vertices)


# The body as positions (V, 3) of the asset in the path; raises FrameError.
Positions = Annotated[NDArray[np.float32], Depends(_positions)]
NoQuery = Depends(no_query)
NoRepeats = Depends(no_repeats)
MetricsDep = Annotated[Metrics, Depends(_metrics)]
Json = Annotated[Any, Depends(uploads.read_json)]
Parts = Annotated[dict[str, Part], Depends(uploads.read_parts)]
Index = Annotated[int, Path(ge=0, lt=2**31)]
