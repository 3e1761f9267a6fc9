"""Skin packages: all that the fast method reads at run time, for engines and web pages."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import JSONResponse

from rhytid.api.dependencies import AssetId, EngineDep, JobPlaces, Memory, NoRepeats, Slot
from rhytid.api.documentation import UNCHANGED, Responses, binary, problems
from rhytid.api.encoding import WORKING
from rhytid.api.package_files import KEY_HEADER, KINDS, TEXT, ZIP, OpenPackage, opened, sent
from rhytid.api.request_memory import PIECE
from rhytid.api.schemas import Job, PackageQuery
from rhytid.engine.messages import JobInfo, Package

MAKING: Responses = {
    202: {"model": Job, "description": "It is being made: ask again when the job has ended"}
}
FAULTS = problems(404, 409, 413, 416, 422, 429, 503, 507)
FilePath = Annotated[str, Path(description="path of a file, such as `manifest.json`")]
router = APIRouter(prefix="/v1/assets/{asset}/package", tags=["assets"], dependencies=[NoRepeats])


def _documented(*media_types: str) -> Responses:
    whole: Responses = {200: {**binary(*media_types)[200], **KEY_HEADER}}
    part: Responses = {206: {**whole[200], "description": "The bytes of one range"}}
    unchanged: Responses = {304: {**UNCHANGED[304], **KEY_HEADER}}
    return {**whole, **MAKING, **part, **unchanged, **FAULTS}


def _found(
    asset: AssetId,
    engine: EngineDep,
    places: JobPlaces,
    slot: Slot,
    memory: Memory,
    query: Annotated[PackageQuery, Query()],
) -> OpenPackage | JobInfo:
    """The package that is asked for, held open until the answer is sent, or the job that makes
    it."""
    memory.answer(WORKING * PIECE)

    def find() -> Package | JobInfo:
        ask = partial(engine.packages.of, asset, query.levels, query.key)
        found = ask(begin=False)
        if found is None:  # only what starts a job takes a place among those of the caller
            with places() as place:
                found = ask()
                if isinstance(found, JobInfo):
                    place.take(found.id)
        assert found is not None
        return found

    with slot:
        found = opened(find)
    return found if isinstance(found, JobInfo) else memory.closing(found)


Found = Annotated[OpenPackage | JobInfo, Depends(_found)]


@router.get("", operation_id="getPackage", response_class=Response, responses=_documented(ZIP))
def package(request: Request, asset: AssetId, found: Found) -> Response:
    """The skin package of a built asset as a zip, stored: mesh with its named shapes, textures,
    shaders, manifest (docs/package.md). It is made when it is first asked for, as a job, and kept
    until the asset is changed or others need the room."""
    answer = _answer(request, found, None)
    if answer.media_type == ZIP:
        answer.headers["Content-Disposition"] = f'attachment; filename="{asset}.skin.zip"'
    return answer


@router.get(
    "/{path:path}",
    operation_id="getPackageFile",
    response_class=Response,
    responses=_documented(*KINDS.values(), TEXT),
)
def file(request: Request, asset: AssetId, path: FilePath, found: Found) -> Response:
    """One file of a skin package, as a web page reads it; a range of its bytes where `Range` asks
    for one."""
    return _answer(request, found, path)


def _answer(request: Request, found: OpenPackage | JobInfo, path: str | None) -> Response:
    if isinstance(found, JobInfo):
        headers = {"Location": f"/v1/jobs/{found.id}", "Retry-After": "1"}
        return JSONResponse(asdict(found), 202, {**headers, "Cache-Control": "no-store"})
    return sent(request, found, path)
