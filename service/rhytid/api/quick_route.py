"""The routes of tiles, without what FastAPI does to find out what a handler asks for.

Solving its dependencies and reading its query by a model take more of the processor than all else
that the server does with a small request, and a tile is asked for more often than anything else.
The routes stay those of FastAPI: in the OpenAPI document, in the table of scopes, and for every
request that is not plainly right, which the usual handler refuses or answers.
"""

from __future__ import annotations

from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from rhytid.api.access import guard
from rhytid.api.dependencies import REPEATED, drawing_of, drawn_positions_of
from rhytid.api.encoded_tiles import Asked
from rhytid.api.encoding import kept_answer, made_answer
from rhytid.api.schemas import TileQuery, TilesQuery
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery

_ADDRESS = ("udim", "level", "row", "column")
# Names of the query, and what they are where they are not given.
_QUERY = {name: str(field.default) for name, field in TileQuery.model_fields.items()}
# Digits of a number that is surely in the range of the route.
_DIGITS = 9


class TileRoute(APIRoute):
    """Answers plain requests for a tile itself."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See Starlette's `Route`."""
        request = Request(scope, receive, send)
        place, query = _address(request), _query(request)
        if place is None or query is None or scope["method"] not in (self.methods or ()):
            await super().handle(scope, receive, send)
            return
        response = await _answered(request, place, query)
        await response(scope, receive, send)


class TilesRoute(APIRoute):
    """Reads plain requests for tiles of positions that are sent with them, and calls the handler
    itself."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See Starlette's `Route`."""
        request = Request(scope, receive, send)
        query = _tiles_query(request)
        if query is None or scope["method"] not in (self.methods or ()):
            await super().handle(scope, receive, send)
            return
        await guard(request)
        asset, drawing = request.path_params["asset"], await drawing_of(request)
        positions = await drawn_positions_of(request, asset, drawing.engine)
        response = await run_in_threadpool(self.endpoint, drawing, asset, positions, query)
        await response(scope, receive, send)


async def _answered(request: Request, place: TileAddress, query: dict[str, str]) -> Response:
    """The answer to a plain request. Errors go to the handlers of the app."""
    await guard(request)
    path, drawing = request.path_params, await drawing_of(request)
    wanted = MapQuery(query["method"], query["stretch"], query["sampling"], query["layer"])
    asked = Asked(query["format"], path["asset"], path["frame"], wanted, place)
    if (kept := kept_answer(request, drawing, asked)) is not None:
        return kept
    return await run_in_threadpool(made_answer, request, drawing, asked)


def _address(request: Request) -> TileAddress | None:
    """The address in the path; None where one of its numbers is not plain."""
    texts = [request.path_params[name] for name in _ADDRESS]
    if not all(text.isascii() and text.isdigit() and len(text) <= _DIGITS for text in texts):
        return None
    return TileAddress(*map(int, texts))


def _query(request: Request) -> dict[str, str] | None:
    """The query; None where it has something else, or something twice."""
    given = request.query_params.multi_items()
    found = dict(given)
    if len(found) != len(given) or not found.keys() <= _QUERY.keys():
        return None
    return {**_QUERY, **found}


def _tiles_query(request: Request) -> TilesQuery | None:
    """The query; None where it is not one, or has something twice that is no list."""
    given = request.query_params.multi_items()
    found: dict[str, Any] = {}
    for name, value in given:
        if name in REPEATED:
            found.setdefault(name, []).append(value)
        elif name in found:
            return None
        else:
            found[name] = value
    try:
        return TilesQuery.model_validate(found)
    except ValidationError:
        return None
