"""Skin packages: all that the fast method reads at run time, for engines and web pages."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from rhytid.api.dependencies import AssetId, EngineDep, Memory, NoRepeats, Slot
from rhytid.api.documentation import UNCHANGED, Responses, binary, problems
from rhytid.api.encoding import WORKING, etag, matches
from rhytid.api.package_files import KINDS, TEXT, ZIP, media_type, opened, part
from rhytid.api.problems import problem
from rhytid.api.request_memory import PIECE
from rhytid.api.schemas import Job, PackageQuery
from rhytid.engine.messages import JobInfo

MAKING: Responses = {
    202: {"model": Job, "description": "It is being made: ask again when the job has ended"}
}
FILES = binary(*KINDS.values(), TEXT)
FAULTS = problems(404, 409, 413, 422, 503, 507)
FilePath = Annotated[str, Path(description="path of a file, such as `manifest.json`")]
router = APIRouter(prefix="/v1/assets/{asset}/package", tags=["assets"], dependencies=[NoRepeats])


@router.get(
    "",
    operation_id="getPackage",
    response_class=Response,
    responses={**binary(ZIP), **MAKING, **UNCHANGED, **FAULTS},
)
def package(
    request: Request,
    asset: AssetId,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    query: Annotated[PackageQuery, Query()],
) -> Response:
    """The skin package of a built asset as a zip, stored: mesh with its named shapes, textures,
    shaders, manifest (docs/package.md). It is made when it is first asked for, as a job, and kept
    until the asset is changed or others need the room."""
    memory.answer(WORKING * PIECE)
    with slot:
        found = opened(partial(engine.packages.of, asset, query.levels))
    if isinstance(found, JobInfo):
        return _making(found)
    memory.closing(found)
    headers = {"ETag": etag(found.key), "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    if found.zip_size is not None:
        headers["Content-Length"] = str(found.zip_size)
    headers["Content-Disposition"] = f'attachment; filename="{asset}.skin.zip"'
    return StreamingResponse(found.zipped(), headers=headers, media_type=ZIP)


@router.get(
    "/{path:path}",
    operation_id="getPackageFile",
    response_class=Response,
    responses={
        **FILES,
        **MAKING,
        206: {**FILES[200], "description": "The bytes of one range"},
        **UNCHANGED,
        **FAULTS,
        **problems(416),
    },
)
def file(
    request: Request,
    asset: AssetId,
    path: FilePath,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    query: Annotated[PackageQuery, Query()],
) -> Response:
    """One file of a skin package, as a web page reads it; a range of its bytes where `Range` asks
    for one."""
    memory.answer(WORKING * PIECE)
    with slot:
        found = opened(partial(engine.packages.of, asset, query.levels), path)
    if isinstance(found, JobInfo):
        return _making(found)
    memory.closing(found)
    size = found.sizes[path]
    headers = {"ETag": etag(found.key, path), "Cache-Control": "no-cache", "Accept-Ranges": "bytes"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    asked = request.headers.get("range")
    if request.headers.get("if-range", headers["ETag"]) != headers["ETag"]:
        asked = None
    try:
        wanted = part(asked, size)
    except ValueError:
        about = {"Content-Range": f"bytes */{size}"}
        return problem(416, f"{path} has {size} bytes: {asked} names none of them", headers=about)
    start, end = wanted or (0, size)
    if wanted is not None:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{size}"
    headers["Content-Length"] = str(end - start)
    status = 200 if wanted is None else 206
    pieces = found.pieces(path, start, end)
    return StreamingResponse(pieces, status, headers, media_type(path))


def _making(job: JobInfo) -> Response:
    headers = {"Location": f"/v1/jobs/{job.id}", "Retry-After": "1", "Cache-Control": "no-store"}
    return JSONResponse(asdict(job), 202, headers)
