"""Displacement tiles and whole maps: what the service is for."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from numpy.typing import NDArray

from rhytid.api.dependencies import (
    AssetId,
    Column,
    DrawingDep,
    DrawnPositions,
    FrameName,
    Level,
    NoRepeats,
    Row,
    Udim,
)
from rhytid.api.documentation import POSITIONS, TILES, TILES_ONCE, problems
from rhytid.api.encoded_tiles import Asked
from rhytid.api.encoding import (
    WORKING,
    answer,
    check_format,
    scale_header,
    texel_bytes,
    warnings_header,
)
from rhytid.api.multipart import MixedPart, mixed_response
from rhytid.api.quick_route import TileRoute, TilesRoute
from rhytid.api.schemas import TileQuery, TilesQuery, WholeMapQuery
from rhytid.device.figures import working_on
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.domain.wording import plural
from rhytid.engine.frames import Frame
from rhytid.engine.messages import AssetDimensions
from rhytid.errors import LimitError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import encode

# One answer holds no more texels than the largest map has.
TEXELS = 16384**2
FAULTS = problems(404, 409, 422, 503, 507)
_ROUTES: dict[str, Any] = {
    "prefix": "/v1/assets/{asset}", "tags": ["tiles"], "dependencies": [NoRepeats]
}  # fmt: skip
tile_router = APIRouter(**_ROUTES, route_class=TileRoute)
tiles_router = APIRouter(**_ROUTES, route_class=TilesRoute)
router = APIRouter(**_ROUTES)


# `TileRoute` answers plain requests without this.
@tile_router.head("/frames/{frame}/tiles/{udim}/{level}/{row}/{column}", include_in_schema=False)
@tile_router.get(
    "/frames/{frame}/tiles/{udim}/{level}/{row}/{column}",
    operation_id="getTile",
    response_class=Response,
    responses={**TILES, **FAULTS},
)
def tile(
    request: Request,
    drawing: DrawingDep,
    asset: AssetId,
    frame: FrameName,
    udim: Udim,
    level: Level,
    row: Row,
    column: Column,
    query: Annotated[TileQuery, Query()],
) -> Response:
    """One tile of displacement; `If-None-Match` is answered without drawing it."""
    place = TileAddress(udim, level, row, column)
    return answer(request, drawing, Asked(query.format, asset, frame, query.map_query(), place))


@router.head("/frames/{frame}/maps/{udim}", include_in_schema=False)
@router.get(
    "/frames/{frame}/maps/{udim}",
    operation_id="getMap",
    response_class=Response,
    responses={**TILES, **FAULTS},
)
def whole_map(
    request: Request,
    drawing: DrawingDep,
    asset: AssetId,
    frame: FrameName,
    udim: Udim,
    query: Annotated[WholeMapQuery, Query()],
) -> Response:
    """A whole map of one UDIM; equals its tiles bit for bit."""
    place = MapAddress(udim, query.level)
    return answer(request, drawing, Asked(query.format, asset, frame, query.map_query(), place))


# `TilesRoute` calls this with what it has read.
@tiles_router.post(
    "/tiles",
    operation_id="drawTiles",
    response_class=Response,
    responses={**TILES_ONCE, **FAULTS, **problems(413)},
    openapi_extra=POSITIONS,
)
def tiles_once(
    drawing: DrawingDep,
    asset: AssetId,
    positions: DrawnPositions,
    query: Annotated[TilesQuery, Query()],
) -> Response:
    """Positions in, tiles out, nothing stored: multipart/mixed in the order of `tile`.

    What is probably wrong with the positions is in the header `X-Rhytid-Warnings`.
    """
    check_format(query.format, query.layer)
    engine, metrics, memory = drawing.engine, drawing.metrics, drawing.memory
    wanted, frame = query.map_query(), Frame.of(positions)
    addresses = [TileAddress.parse(text) for text in query.tile]
    texels = check_texels(engine.assets.dimensions(asset), addresses)
    warnings = engine.frames.warnings(asset, frame, strict=query.strict, allow=query.allow)
    parts = []
    with drawing.slot:
        hold = memory.answer(WORKING * texel_bytes(wanted) * texels)
        for address in addresses:
            drawn = engine.tiles.draw(asset, frame, wanted, address)
            with working_on(wanted.method), metrics.figures.stage("encode"):
                parts.append(mixed_part(drawn.tile, query.format, drawn.description.header))
            metrics.tiles_of(wanted.method).inc()
    mixed = mixed_response(parts, warnings_header(warnings))
    hold.resize(len(mixed.body))
    return mixed


def check_texels(asset: AssetDimensions, addresses: list[TileAddress]) -> int:
    """Texels of these tiles; raises LimitError where one answer would hold more than the largest
    map has, NotFoundError naming what there is not."""
    for address in addresses:
        asset.check(address)
    texels = sum(asset.grid.texels(address.level) ** 2 for address in addresses)
    if texels > TEXELS:
        raise LimitError(
            f"{plural(len(addresses), 'tile holds', 'tiles hold')} {texels} texels: at most "
            f"{TEXELS} per answer"
        )
    return texels


def mixed_part(tile: NDArray[np.float32], format: str, header: TileHeader) -> MixedPart:
    """One encoded tile and the headers that identify it."""
    encoded = encode(tile, format, header)
    at = TileAddress(header.udim, header.level, header.row, header.column)
    name = str(at).replace("/", ".")
    headers = {
        "Content-Type": encoded.media_type,
        "Content-Disposition": f'attachment; filename="{name}{encoded.extension}"',
        "X-Rhytid-Tile": str(at),
        **scale_header(format, header),
    }
    return MixedPart(headers, encoded.body)
