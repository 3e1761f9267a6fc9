"""Pages for browsers: the start `/`, which is the viewer or, as JSON, the paths to start from; the
files of the viewer; and `/docs`. Pages load nothing from other hosts."""

from __future__ import annotations

from importlib import resources
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse
from starlette.exceptions import HTTPException

import rhytid_viewer
from rhytid import __version__
from rhytid.api.accept import preferred
from rhytid.api.dependencies import NoQuery
from rhytid.api.documentation import problems
from rhytid.api.encoding import tagged
from rhytid.api.schemas import Root

JSON, HTML = "application/json", "text/html"
# Swagger UI, as the package fastapi-swagger holds it.
ASSETS = "fastapi_swagger.resources"
FILES = ("swagger-ui-bundle.js", "swagger-ui.css", "favicon-32x32.png")
PLACES = {
    "docs": "/docs",
    "openapi": "/openapi.json",
    "assets": "/v1/assets",
    "devices": "/v1/devices",
    "health": "/healthz",
    "metrics": "/metrics",
}
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
router = APIRouter(tags=["service"])


@router.get(
    "/",
    operation_id="getRoot",
    response_model=Root,
    responses={200: {"content": {HTML: {"schema": {"type": "string"}}}}, **problems(406, 422)},
    dependencies=[NoQuery],
)
async def root(request: Request) -> Response:
    """The version, and the paths to start from, as JSON; the viewer, a page, where `Accept` prefers
    `text/html`."""
    prefix = request.scope.get("root_path", "")
    places = {name: prefix + path for name, path in PLACES.items()}
    headers = {"Vary": "Accept"}
    if preferred(request, (JSON, HTML)) == JSON:
        found: dict[str, Any] = {"name": "rhytid", "version": __version__, **places}
        return JSONResponse(found, headers=headers)
    page = _viewer_answer(rhytid_viewer.PAGE, request)
    page.headers.update(headers)
    return page


@router.get("/docs", include_in_schema=False)
async def docs(request: Request) -> HTMLResponse:
    """Swagger UI over the OpenAPI document."""
    prefix = request.scope.get("root_path", "")
    return get_swagger_ui_html(
        openapi_url=f"{prefix}/openapi.json",
        title="rhytid",
        swagger_js_url=f"{prefix}/docs/swagger-ui-bundle.js",
        swagger_css_url=f"{prefix}/docs/swagger-ui.css",
        swagger_favicon_url=f"{prefix}/docs/favicon-32x32.png",
        # Else the page asks a server on the internet whether the document is valid.
        swagger_ui_parameters={"validatorUrl": None},
    )


@router.get("/docs/{file}", include_in_schema=False)
def docs_file(file: str) -> FileResponse:
    """One of the files that the page of `/docs` loads."""
    if file not in FILES:
        raise HTTPException(404)
    return FileResponse(str(resources.files(ASSETS) / file))


@router.get(
    f"/{rhytid_viewer.FOLDER}/{{file:path}}", include_in_schema=False, dependencies=[NoQuery]
)
def viewer_file(file: str, request: Request) -> Response:
    """One of the files that the viewer loads."""
    if file not in rhytid_viewer.names():
        raise HTTPException(404)
    return _viewer_answer(file, request)


def _viewer_answer(name: str, request: Request) -> Response:
    """Answer with a file of the viewer; 304 where the browser has these bytes."""
    answer = tagged(request, rhytid_viewer.read(name), rhytid_viewer.media_type(name))
    answer.headers.update(SAFE)
    return answer
