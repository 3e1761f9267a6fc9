"""Skin packages: all that the fast method reads at run time, for engines and web pages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import PurePosixPath
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from rhytid.api.dependencies import AssetId, EngineDep, JobPlaces, Memory, NoRepeats, Slot
from rhytid.api.documentation import UNCHANGED, Responses, binary, problems
from rhytid.api.encoding import WORKING, etag, matches
from rhytid.api.problems import problem
from rhytid.api.request_memory import PIECE
from rhytid.api.routes.pages import SAFE
from rhytid.api.schemas import Job, PackageQuery
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import BusyError, NotFoundError
from rhytid.support.atomic_files import storage_errors

ZIP = "application/zip"
KINDS = {
    ".json": "application/json",
    ".ktx2": "image/ktx2",
    ".glb": "model/gltf-binary",
    ".bin": "application/octet-stream",
    ".js": "text/javascript; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".mtlx": "application/xml",
}
TEXT = "text/plain; charset=utf-8"
# The key of the package that an answer is of.
KEY = "X-Rhytid-Package"
KEY_HEADER = {
    "headers": {
        KEY: {
            "schema": {"type": "string"},
            "description": "key of the package, as the query parameter `key` takes it",
        }
    }
}
# One range; any other header is answered with the whole file.
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII)
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


class OpenPackage:
    """A package that is held open, so that it stays whole when its file is removed; close it."""

    def __init__(self, package: Package) -> None:
        """Open the package; raises OSError where it cannot be opened, or its file is gone."""
        self.key, self.nbytes, self.files = package.key, package.nbytes, package.files
        self._file = package.file.open("rb")

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()

    def place(self, name: str | None) -> range:
        """Return where the bytes of a file lie; None = of all as one zip. Raises NotFoundError."""
        if name is None:
            return range(self.nbytes)
        if name not in self.files:
            raise NotFoundError(f"the package has no file {name!r}")
        return self.files[name]

    def pieces(self, place: range) -> Iterator[bytes]:
        """Yield the bytes of a range."""
        left = len(place)
        with storage_errors("a package cannot be read"):
            self._file.seek(place.start)
            while left and (piece := self._file.read(min(left, PIECE))):
                left -= len(piece)
                yield piece


def opened(find: Callable[[], Package | JobInfo]) -> OpenPackage | JobInfo:
    """Open the package that `find` returns, or return the job that makes it.

    Raises TooManyFilesError where no more files can be opened, BusyError where packages are removed
    as fast as they are made.
    """
    for _ in range(3):
        found = find()
        if isinstance(found, JobInfo):
            return found
        with storage_errors("a package cannot be opened"), suppress(FileNotFoundError):
            return OpenPackage(found)
        # It was removed since: it is made again.
    raise BusyError("packages are removed as fast as they are made: there is no room for them")


def _found(
    asset: AssetId,
    engine: EngineDep,
    places: JobPlaces,
    slot: Slot,
    memory: Memory,
    query: Annotated[PackageQuery, Query()],
) -> OpenPackage | JobInfo:
    """Return the package that is asked for, held open until the answer is sent, or the job that
    makes it."""
    memory.answer(WORKING * PIECE)

    def find() -> Package | JobInfo:
        ask = partial(engine.packages.of, asset, query.levels, query.key)
        found = ask(begin=False)
        if found is None:  # only a request that starts a job needs a claim to one
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
    return _sent(request, found, path)


def _sent(request: Request, found: OpenPackage, name: str | None) -> Response:
    """Answer with a file of a package, or all of it as one zip: 304 where the client has it, 206
    with a range of its bytes where it asks for one, 416 where there are none in that range."""
    place = found.place(name)
    tag = etag(found.key, name or ZIP)
    headers = {**SAFE, KEY: found.key, "ETag": tag, "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    headers["Accept-Ranges"] = "bytes"
    asked = request.headers.get("range")
    if request.headers.get("if-range", tag) != tag:
        asked = None
    try:
        wanted = byte_range(asked, len(place))
    except ValueError:
        headers = {**SAFE, KEY: found.key, "Content-Range": f"bytes */{len(place)}"}
        return problem(416, f"{asked}: there are {len(place)} bytes", headers=headers)
    start, end = wanted or (0, len(place))
    if wanted is not None:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{len(place)}"
    headers["Content-Length"] = str(end - start)
    kind = ZIP if name is None else _media_type(name)
    status = 200 if wanted is None else 206
    return StreamingResponse(found.pieces(place[start:end]), status, headers, kind)


def _media_type(name: str) -> str:
    """The media type of a file of a package."""
    return KINDS.get(PurePosixPath(name).suffix, TEXT)


def byte_range(header: str | None, size: int) -> tuple[int, int] | None:
    """Return the first byte of a range of a file and the byte after its last; None = the whole
    file.

    Raises ValueError where the file has no byte of it (RFC 9110, section 14.1.2).
    """
    found = _RANGE.fullmatch(header or "")
    if found is None or found.groups() == ("", ""):
        return None
    first, last = found.groups()
    if not first:  # the last so many
        start, end = max(size - int(last), 0), size
    else:
        start, end = int(first), min(int(last) + 1, size) if last else size
        if last and int(last) < start:
            return None
    if start >= end:
        raise ValueError(header)
    return start, end
