"""Wrinkle graphs: as they are stored, and as lines in space for other programs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from rhytid.api.dependencies import AssetId, EngineDep, Memory, NoRepeats, Slot
from rhytid.api.documentation import UNCHANGED, binary, problems
from rhytid.api.encoding import answer_stored
from rhytid.api.schemas import GraphQuery
from rhytid.exports.curves import CURVE_FORMATS, curve_format
from rhytid.formats.graphs import write_graph

SAFETENSORS = "application/vnd.safetensors"
MEDIA_TYPES = (SAFETENSORS, *(kind.media_type for kind in CURVE_FORMATS.values()))
router = APIRouter(prefix="/v1/assets", tags=["assets"], dependencies=[NoRepeats])


@router.get(
    "/{asset}/graph",
    operation_id="getGraph",
    response_class=Response,
    responses={**binary(*MEDIA_TYPES), **UNCHANGED, **problems(404, 409, 422, 503, 507)},
)
def graph(
    request: Request,
    asset: AssetId,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    query: Annotated[GraphQuery, Query()],
) -> Response:
    """The wrinkle graph as safetensors, whose metadata say with which lengths (in which unit) and
    which seed it is drawn, and for which mesh; or its wrinkles as lines in space, as OBJ or
    USD text."""
    kind = None if query.format == "safetensors" else curve_format(query.format)

    def write() -> bytes | Iterable[bytes]:
        if kind is None:
            return write_graph(engine.assets.graph(asset), {"asset": asset})
        return kind.write(engine.assets.curves(asset), engine.assets.info(asset).settings["unit"])

    media_type = SAFETENSORS if kind is None else kind.media_type
    content = partial(engine.assets.content, asset)
    return answer_stored(request, query.format, content, write, media_type, slot, memory)
