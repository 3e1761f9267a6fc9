"""Neutral meshes, as other programs read them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from rhytid.api.dependencies import AssetId, EngineDep, NoRepeats
from rhytid.api.documentation import binary, problems
from rhytid.api.schemas import MeshQuery
from rhytid.meshes.export import MESH_FORMATS, flat_mesh, mesh_format

MEDIA_TYPES = tuple(kind.media_type for kind in MESH_FORMATS.values())
router = APIRouter(prefix="/v1/assets", tags=["assets"], dependencies=[NoRepeats])


@router.get(
    "/{asset}/mesh",
    operation_id="getMesh",
    response_class=Response,
    responses={**binary(*MEDIA_TYPES), **problems(404, 409, 422)},
)
def mesh(asset: AssetId, engine: EngineDep, query: Annotated[MeshQuery, Query()]) -> Response:
    """The neutral mesh where it was sent, with one uv per vertex. The vertices that were sent come
    first, in their order; what is split along UV seams comes after. GLB holds float32, PLY
    doubles where they are needed."""
    kind = mesh_format(query.format)
    return Response(kind.write(flat_mesh(engine.assets.mesh(asset))), media_type=kind.media_type)
