"""Wrinkle graphs: as they are stored, and as lines in space for other programs."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from fastapi.responses import StreamingResponse

from rhytid.api.dependencies import AssetId, EngineDep, NoRepeats
from rhytid.api.documentation import binary, problems
from rhytid.api.schemas import GraphQuery
from rhytid.formats.curves import CURVE_FORMATS, curve_format
from rhytid.formats.graphs import write_graph

SAFETENSORS = "application/vnd.safetensors"
MEDIA_TYPES = (SAFETENSORS, *(kind.media_type for kind in CURVE_FORMATS.values()))
router = APIRouter(prefix="/v1/assets", tags=["assets"], dependencies=[NoRepeats])


@router.get(
    "/{asset}/graph",
    operation_id="getGraph",
    response_class=Response,
    responses={**binary(*MEDIA_TYPES), **problems(404, 409, 422)},
)
def graph(asset: AssetId, engine: EngineDep, query: Annotated[GraphQuery, Query()]) -> Response:
    """The wrinkle graph as safetensors, whose metadata say with which depth, spacing, unit, sigma
    and wave frequency it is drawn, and for which mesh; or its wrinkles as lines in space, as OBJ or
    USD text."""
    if query.format == "safetensors":
        return Response(
            write_graph(engine.assets.graph(asset), {"asset": asset}), media_type=SAFETENSORS
        )
    kind = curve_format(query.format)
    pieces = kind.write(engine.assets.curves(asset), engine.assets.info(asset).settings["unit"])
    return StreamingResponse(pieces, media_type=kind.media_type)
