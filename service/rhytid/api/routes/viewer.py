"""The viewer: a page for browsers and the files that it loads, all from this server."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

import rhytid_viewer
from rhytid.api.dependencies import NoQuery
from rhytid.api.encoding import tagged

# Nothing from elsewhere, no text in the page is run, and no other page may frame this one. `blob:`
# is for pictures that the page itself made.
POLICY = (
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
SAFE = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
router = APIRouter(tags=["service"], dependencies=[NoQuery])


@router.get(f"/{rhytid_viewer.FOLDER}/{{file:path}}", include_in_schema=False)
def viewer_file(file: str, request: Request) -> Response:
    """One of the files that the page of `/` loads."""
    if file not in rhytid_viewer.names():
        raise HTTPException(404)
    return viewer_answer(file, request)


def viewer_answer(name: str, request: Request) -> Response:
    """A file of the viewer; 304 where the browser has these bytes."""
    answer = tagged(request, rhytid_viewer.read(name), rhytid_viewer.media_type(name))
    answer.headers.update(SAFE)
    return answer
