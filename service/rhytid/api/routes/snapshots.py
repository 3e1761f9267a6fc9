"""Snapshots: a built asset as one file, for other servers."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse

from rhytid.api.dependencies import AssetId, EngineDep, Memory, NoQuery, Slot, SnapshotBody
from rhytid.api.documentation import SNAPSHOT, UNCHANGED, binary, problems
from rhytid.api.encoding import WORKING, etag, matches
from rhytid.api.request_memory import PIECE
from rhytid.api.schemas import Asset
from rhytid.api.uploads import TAR
from rhytid.storage.snapshots import OpenFile

router = APIRouter(prefix="/v1", tags=["assets"], dependencies=[NoQuery])


@router.get(
    "/assets/{asset}/snapshot",
    operation_id="getSnapshot",
    response_class=Response,
    responses={**binary(TAR), **UNCHANGED, **problems(404, 409, 422, 503, 507)},
)
def snapshot(
    request: Request, asset: AssetId, engine: EngineDep, slot: Slot, memory: Memory
) -> Response:
    """A built asset as one file, which `POST /v1/snapshots` of any server takes: mesh, wrinkles,
    settings, stiffness maps, what was found in the build and the present settings, each with its
    SHA-256. The same asset gives the same bytes. Frames are not in it."""
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
