"""Neutral meshes, as other programs read them."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from rhytid.api.dependencies import AssetId, EngineDep, Memory, NoRepeats, Slot
from rhytid.api.documentation import UNCHANGED, binary, problems
from rhytid.api.encoding import answer_stored
from rhytid.api.schemas import MeshQuery
from rhytid.exports.meshes import MESH_FORMATS, flat_mesh, mesh_format

MEDIA_TYPES = tuple(kind.media_type for kind in MESH_FORMATS.values())
router = APIRouter(prefix="/v1/assets", tags=["assets"], dependencies=[NoRepeats])


@router.get(
    "/{asset}/mesh",
    operation_id="getMesh",
    response_class=Response,
    responses={**binary(*MEDIA_TYPES), **UNCHANGED, **problems(404, 409, 422, 503, 507)},
)
def mesh(
    request: Request,
    asset: AssetId,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    query: Annotated[MeshQuery, Query()],
) -> Response:
    """The neutral mesh where it was sent, with one uv per vertex. The vertices that were sent come
    first, in their order; what is split along UV seams comes after. GLB holds float32, PLY
    doubles where they are needed."""
    kind = mesh_format(query.format)
    content = partial(engine.assets.content, asset)

    def write() -> bytes:
        return kind.write(flat_mesh(engine.assets.mesh(asset)))

    return answer_stored(request, query.format, content, write, kind.media_type, slot, memory)
