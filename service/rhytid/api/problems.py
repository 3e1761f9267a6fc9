"""Every error as an RFC 9457 problem: one table from exception to status, and the handlers."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from rhytid import errors
from rhytid.domain.warnings import InputWarning
from rhytid.support.logs import request_id

MEDIA_TYPE = "application/problem+json"
LONGEST_DETAIL = 2000
# Characters of a wrong value that are shown: of a live connection the reason has 121 in all.
_LONGEST_FOUND = 24
# Statuses after which a caller may ask again later; they are counted by kind.
_REFUSALS = (429, 503, 507)
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Kind:
    """How a client sees an exception."""

    status: int
    name: str
    title: str

    @property
    def type(self) -> str:
        """The problem type, a URI that names the kind and is not meant to be opened."""
        return f"urn:rhytid:problem:{self.name}"


# The nearest base class of an exception that stands here decides.
KINDS: dict[type[BaseException], Kind] = {
    errors.MeshError: Kind(422, "mesh", "The mesh cannot be used"),
    errors.GraphError: Kind(422, "graph", "The wrinkle graph cannot be used"),
    errors.ShapesError: Kind(422, "shapes", "The shapes cannot be used"),
    errors.FrameError: Kind(422, "frame", "The frame cannot be used"),
    errors.SettingsError: Kind(422, "settings", "The settings cannot be used"),
    errors.QueryError: Kind(422, "query", "The query cannot be answered"),
    errors.SnapshotError: Kind(422, "snapshot", "The snapshot cannot be used"),
    errors.StrictError: Kind(422, "warnings", "There are warnings, and strict was asked for"),
    errors.InputError: Kind(422, "input", "The request cannot be used"),
    errors.NotFoundError: Kind(404, "not-found", "Not found"),
    errors.NotReadyError: Kind(409, "not-ready", "The asset is not ready"),
    errors.ReadOnlyError: Kind(409, "read-only", "Cannot be written"),
    errors.ChangedError: Kind(409, "changed", "The asset has changed"),
    errors.ConflictError: Kind(409, "conflict", "Not possible in the present state"),
    errors.ApiKeyError: Kind(401, "key", "An API key is needed"),
    errors.ScopeError: Kind(403, "scope", "The API key does not allow this"),
    errors.AccessError: Kind(403, "access", "Not allowed"),
    errors.QuotaError: Kind(429, "quota", "More than one caller may ask for"),
    errors.CancelledError: Kind(409, "cancelled", "The job was cancelled"),
    errors.FrameMemoryError: Kind(507, "frame-memory", "The memory for frames is full"),
    errors.HostMemoryError: Kind(507, "host-memory", "Beyond the memory for requests"),
    errors.LimitError: Kind(413, "limit", "Larger than this server allows"),
    errors.HostBusyError: Kind(503, "host-busy", "The memory for requests is in use"),
    errors.FetchingError: Kind(503, "fetching", "The asset is being fetched"),
    errors.DrainingError: Kind(503, "draining", "The server is shutting down"),
    errors.BusyError: Kind(503, "busy", "The queue of the device is full"),
    errors.NoDeviceError: Kind(503, "no-device", "No OpenCL device computes"),
    errors.DeviceMemoryError: Kind(507, "device-memory", "Beyond the device memory budget"),
    errors.DeviceLostError: Kind(503, "device-lost", "The process of the device restarts"),
    errors.FatalRequestError: Kind(422, "fatal-request", "The device failed twice at this"),
    errors.DeviceError: Kind(500, "device", "The device failed"),
    errors.FarmError: Kind(502, "farm", "A cluster does not answer"),
    errors.DiskFullError: Kind(507, "disk-full", "The disk is full"),
    errors.TooManyFilesError: Kind(503, "open-files", "Too many files are open"),
    errors.StoreFormatError: Kind(409, "store-format", "Of another version of rhytid"),
    errors.SharedStoreError: Kind(503, "shared-store", "The shared store cannot be used"),
    errors.SharedDamageError: Kind(409, "shared-damage", "Damaged in the shared store"),
    errors.StorageError: Kind(500, "storage", "The store failed"),
    errors.RhytidError: Kind(500, "internal", "Internal error"),
}


def kind_of(error: errors.RhytidError) -> Kind:
    """Return the row of the table for an exception."""
    return next(KINDS[base] for base in type(error).__mro__ if base in KINDS)


def problem(
    status: int,
    detail: str,
    title: str | None = None,
    type: str = "about:blank",
    headers: Mapping[str, str] | None = None,
    **extra: Any,
) -> Response:
    """Return an `application/problem+json` response; the title defaults to the phrase of the
    status."""
    clipped = detail if len(detail) <= LONGEST_DETAIL else detail[: LONGEST_DETAIL - 1] + "…"
    title = title or HTTPStatus(status).phrase
    body = {"type": type, "title": title, "status": status, "detail": clipped, **extra}
    if wanted := request_id.get():
        body["request_id"] = wanted
    # ASCII escapes: a detail may quote a lone surrogate from the client's JSON.
    return Response(json.dumps(body), status, headers, media_type=MEDIA_TYPE)


def install(app: FastAPI) -> None:
    """Have every exception of the app, the framework's own too, answered with a problem."""
    app.add_exception_handler(errors.RhytidError, _deliberate)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _framework)
    app.add_exception_handler(ClientDisconnect, _gone)
    app.add_exception_handler(Exception, _unexpected)


async def _deliberate(request: Request, error: Exception) -> Response:
    assert isinstance(error, errors.RhytidError)
    kind = kind_of(error)
    if isinstance(error, errors.StorageError) and kind.status != HTTPStatus.INTERNAL_SERVER_ERROR:
        logger.error("%s: %s", _call(request), error)
    # A message may hold paths and build logs of this server: it is only logged.
    if kind.status == HTTPStatus.INTERNAL_SERVER_ERROR:
        logger.error("%s failed", _call(request), exc_info=error)
        return problem(kind.status, "the server's log has the reason", kind.title, kind.type)
    if kind.status in _REFUSALS:
        request.app.state.metrics.refused.labels(kind.name).inc()
    retry = getattr(error, "retry_after", None)
    headers = {} if retry is None else {"Retry-After": str(retry)}
    if kind.status == HTTPStatus.UNAUTHORIZED:
        headers["WWW-Authenticate"] = 'Bearer realm="rhytid"'
    extra = {}
    if isinstance(error, errors.StrictError):
        extra["warnings"] = [asdict(w) for w in error.warnings if isinstance(w, InputWarning)]
    return problem(
        kind.status, errors.public_message(error), kind.title, kind.type, headers, **extra
    )


async def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    faults = error.errors()
    in_body = any(fault["loc"][0] == "body" for fault in faults)
    kind = KINDS[errors.InputError if in_body else errors.QueryError]
    return problem(kind.status, "; ".join(map(_fault, faults)), kind.title, kind.type)


def _fault(fault: Mapping[str, Any]) -> str:
    place, *path = (str(step) for step in fault["loc"])
    return fault_at(f"{place} parameter {'.'.join(path)}", fault)


def fault_at(where: str, fault: Mapping[str, Any]) -> str:
    """What pydantic found wrong at a place, in our words."""
    if fault["type"] == "extra_forbidden":
        return f"unknown {where}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    found = repr(fault["input"])
    if len(found) > _LONGEST_FOUND:
        found = found[:_LONGEST_FOUND] + "…"
    said = fault["msg"].replace("Input should be", "must be").replace(" after validation", "")
    return f"{where} is {found}: {said}"


async def _framework(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    detail = error.detail
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(sorted(_methods(request))) or headers.get("Allow", "")
        detail = f"{request.method} is not possible here: {headers['Allow']}"
    elif error.status_code == HTTPStatus.NOT_FOUND:
        detail = f"no such path: {request.url.path}"
    return problem(error.status_code, detail, headers=headers)


def _methods(request: Request) -> set[str]:
    """All methods of a path; the router itself names those of its first route alone."""
    routes = request.app.state.routes
    path = request.scope["path"]
    return {method for r in routes if r.path_regex.match(path) for method in r.methods}


async def _gone(request: Request, error: Exception) -> Response:
    return problem(400, "the client closed the connection before the body was complete")


async def _unexpected(request: Request, error: Exception) -> Response:
    # The exception goes on to the ASGI server, which logs its trace and ends the connection:
    # without the header a client would ask again on a connection that is about to break.
    logger.error("%s failed: %s", _call(request), type(error).__name__)
    # This is answered outside of the middleware that adds the id to the other answers.
    headers = {"Connection": "close", "X-Request-Id": request_id.get()}
    return problem(500, "the server's log has the reason", headers=headers)


def _call(request: Request) -> str:
    return f"{request.scope.get('method', 'WS')} {request.url.path!r}"
