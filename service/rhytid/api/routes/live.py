"""The live connection: frames in, tiles out, over a WebSocket."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from fastapi import APIRouter, WebSocket
from starlette.concurrency import run_in_threadpool

from rhytid.api.access import Caller
from rhytid.api.dependencies import AssetId
from rhytid.api.live.drawing import LiveDrawing
from rhytid.api.live.session import LiveSession
from rhytid.api.live.wire import PROTOCOL, Opening, largest_message
from rhytid.errors import ConflictError, NotReadyError, QueryError

if TYPE_CHECKING:
    from rhytid.engine.messages import AssetInfo

router = APIRouter(prefix="/v1/assets/{asset}", tags=["live"])


@router.websocket("/live")
async def live(websocket: WebSocket, asset: AssetId) -> None:
    """Frames in, tiles out, for as long as it is open (docs/live.md)."""
    _check_query(websocket)
    state, caller = websocket.app.state, Caller.of(websocket.scope)
    with state.live_places.one(caller.name):
        info = await run_in_threadpool(state.engine.assets.info, asset)
        _check_ready(info)
        # A client that offers none means the format that there is.
        subprotocol = PROTOCOL if websocket.scope["subprotocols"] else None
        await _accept(websocket, subprotocol, largest_message(info.vertices))

        def begin(opening: Opening) -> LiveDrawing:
            slot = partial(state.live_slots.one, lambda: session.over)
            drawn = state.metrics.tiles_of(opening.method)
            return LiveDrawing(state.engine, info, opening, slot, drawn)

        dropped = state.metrics.live_dropped
        session = LiveSession(websocket, begin, _facts(info), info.vertices, caller.rate, dropped)
        await session.run()


async def _accept(websocket: WebSocket, subprotocol: str | None, largest: int) -> None:
    """As `websocket.accept`.  largest: bytes of a message, for `rhytid.api.server.web_sockets`."""
    await websocket.receive()
    await websocket.send(
        {"type": "websocket.accept", "subprotocol": subprotocol, "headers": [], "largest": largest}
    )


def _check_query(websocket: WebSocket) -> None:
    if websocket.query_params:
        name = next(iter(websocket.query_params))
        raise QueryError(f"unknown query parameter {name!r}: none is known here")
    offered = websocket.scope["subprotocols"]
    if offered and PROTOCOL not in offered:
        raise QueryError(f"Sec-WebSocket-Protocol must name {PROTOCOL}, the format of messages")


def _check_ready(info: AssetInfo) -> None:
    if info.state == "building":
        raise NotReadyError(f"asset {info.id} is still building")
    if info.state != "ready":
        raise ConflictError(f"asset {info.id} failed to build: {info.reason}")


def _facts(info: AssetInfo) -> dict[str, Any]:
    """The facts of the asset that a client needs, for the answer to the header."""
    settings = info.settings
    return {
        "asset": info.id,
        "vertices": info.vertices,
        "udims": info.udims,
        "levels": info.levels,
        "resolution": settings["resolution"],
        "tile_size": settings["tile_size"],
        "unit": settings["unit"],
    }
