"""Files of an asset: its wrinkle graph and its neutral mesh for other programs, and snapshots for
other servers."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse

from rhytid.api.dependencies import (
    AssetId,
    EngineDep,
    Files,
    Memory,
    NoQuery,
    NoRepeats,
    Slot,
    SnapshotBody,
)
from rhytid.api.documentation import SNAPSHOT, UNCHANGED, binary, in_ranges, problems
from rhytid.api.encoding import WORKING, Written, answer_stored, etag, matches
from rhytid.api.request_memory import PIECE
from rhytid.api.schemas import Asset, GraphQuery, MeshQuery
from rhytid.api.uploads import TAR
from rhytid.exports.curves import CURVE_FORMATS, curve_format
from rhytid.exports.meshes import MESH_FORMATS, flat_mesh, mesh_format
from rhytid.formats.graphs import graph_pieces
from rhytid.storage.snapshots import OpenFile

SAFETENSORS = "application/vnd.safetensors"
GRAPH_TYPES = (SAFETENSORS, *(kind.media_type for kind in CURVE_FORMATS.values()))
MESH_TYPES = tuple(kind.media_type for kind in MESH_FORMATS.values())
FAULTS = problems(404, 409, 422, 503, 507)
router = APIRouter(prefix="/v1", tags=["assets"])


@router.get(
    "/assets/{asset}/graph",
    operation_id="getGraph",
    response_class=Response,
    responses={**in_ranges(*GRAPH_TYPES), **UNCHANGED, **FAULTS},
    dependencies=[NoRepeats],
)
def graph(
    request: Request,
    asset: AssetId,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    files: Files,
    query: Annotated[GraphQuery, Query()],
) -> Response:
    """The wrinkle graph as safetensors, whose metadata say with which lengths (in which unit) and
    which seed it is drawn, and for which mesh; or its wrinkles as lines in space, as OBJ or
    USD text."""
    kind = None if query.format == "safetensors" else curve_format(query.format)

    def write() -> Written:
        if kind is None:
            return list(graph_pieces(engine.assets.graph(asset), {"asset": asset}))
        return kind.write(engine.assets.curves(asset), engine.assets.info(asset).settings["unit"])

    media_type = SAFETENSORS if kind is None else kind.media_type
    content = partial(engine.assets.content, asset)
    kept = files if kind is None else None  # lines in space have no ranges
    return answer_stored(request, query.format, content, write, media_type, slot, memory, kept)


@router.get(
    "/assets/{asset}/mesh",
    operation_id="getMesh",
    response_class=Response,
    responses={**in_ranges(*MESH_TYPES), **UNCHANGED, **FAULTS},
    dependencies=[NoRepeats],
)
def mesh(
    request: Request,
    asset: AssetId,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    files: Files,
    query: Annotated[MeshQuery, Query()],
) -> Response:
    """The neutral mesh where it was sent, with one uv per vertex. The vertices that were sent come
    first, in their order; what is split along UV seams comes after. GLB holds float32, PLY
    doubles where they are needed."""
    kind = mesh_format(query.format)
    content = partial(engine.assets.content, asset)

    def write() -> Written:
        return [kind.write(flat_mesh(engine.assets.mesh(asset)))]

    return answer_stored(
        request, query.format, content, write, kind.media_type, slot, memory, files
    )


@router.get(
    "/assets/{asset}/snapshot",
    operation_id="getSnapshot",
    response_class=Response,
    responses={**binary(TAR), **UNCHANGED, **FAULTS},
    dependencies=[NoQuery],
)
def snapshot(
    request: Request, asset: AssetId, engine: EngineDep, slot: Slot, memory: Memory
) -> Response:
    """A built asset as one file, which `POST /v1/snapshots` of any server takes: mesh, wrinkles,
    settings, stiffness maps, the residual of a scan, what was found in the build and the present
    settings, each with its SHA-256. The same asset gives the same bytes. Frames are not in it."""
    memory.answer(WORKING * PIECE)
    with slot:
        made = memory.closing(engine.snapshots.of(asset))
    headers = {"ETag": etag(made.index.encode()), "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    headers["Content-Length"] = str(made.nbytes)
    headers["Content-Disposition"] = f'attachment; filename="{asset}.rhytid.tar"'
    return StreamingResponse(made.pieces(), headers=headers, media_type=TAR)


@router.post(
    "/snapshots",
    operation_id="restoreSnapshot",
    status_code=201,
    response_model=Asset,
    responses={
        200: {"model": Asset, "description": "The asset is there already and stays as it is"},
        **problems(409, 413, 415, 422, 503, 507),
    },
    openapi_extra=SNAPSHOT,
    dependencies=[NoQuery],
)
def restore(
    body: SnapshotBody, engine: EngineDep, memory: Memory, slot: Slot, response: Response
) -> Any:
    """Take in an asset that a server wrote as a snapshot, under the id that it has there. Nothing
    is synthesised. Every byte is checked first; that its wrinkles are those which its mesh grows
    cannot be, so this takes the scope admin."""
    memory.decode(body.size)
    with slot:
        asset, new = engine.snapshots.restore(OpenFile(body.descriptor()), body.size)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/assets/{asset.id}"
    return asset
