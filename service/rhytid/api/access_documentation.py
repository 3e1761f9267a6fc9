"""What the OpenAPI document says of access: the key, the scope of each call, the refusals."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

from rhytid.api.access import ALIVE, OPEN, ROUTES
from rhytid.api.problems import MEDIA_TYPE

SCHEME = "key"
KEY = {
    "type": "http",
    "scheme": "bearer",
    "description": "A key that `rhytid keys create` made, needed where the server has keys. "
    "Every call names the scope that the key must have.",
}
_PROBLEM = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}


def document_access(document: dict[str, Any]) -> None:
    """Add to every call of a document which scope it needs, and how it may be refused."""
    document["components"]["securitySchemes"] = {SCHEME: KEY}
    for path, calls in document["paths"].items():
        for method, call in calls.items():
            scope = ROUTES[f"{method.upper()} {path}"]
            if scope != OPEN:
                call["security"] = [{SCHEME: [scope]}]
            for status in refusals(path, scope, sends="requestBody" in call):
                described = {"description": HTTPStatus(status).phrase, "content": _PROBLEM}
                call["responses"].setdefault(str(status), described)
            call["responses"] = dict(sorted(call["responses"].items()))


def refusals(path: str, scope: str, *, sends: bool) -> list[int]:
    """Statuses of what is refused before a route sees it.  sends: whether it takes a body."""
    keys = [] if scope == OPEN else [401]
    return [400, *keys, 403, *([415] if sends else []), *([] if path == ALIVE else [429])]
