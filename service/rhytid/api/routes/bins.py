"""Bins: the precomputed, quantised maps of the fast method (section 2.4 of the paper)."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from rhytid.api.dependencies import (
    AssetId,
    Column,
    EngineDep,
    Level,
    Memory,
    NoQuery,
    NoRepeats,
    Row,
    Slot,
    Udim,
)
from rhytid.api.documentation import binary, problems
from rhytid.api.encoding import NPY, WORKING, npy, tagged
from rhytid.api.schemas import BinQuery, Bins
from rhytid.domain.tiles import TileAddress

# Bytes of a code.
WIDEST_CODE = 2
router = APIRouter(prefix="/v1/assets/{asset}/bins", tags=["bins"])


@router.get(
    "",
    operation_id="getBins",
    response_model=Bins,
    responses=problems(404, 409, 422, 503, 507),
    dependencies=[NoQuery],
)
def manifest(asset: AssetId, engine: EngineDep, slot: Slot) -> Any:
    """Angles, samples, steps and layers, and the numbers that blending takes: docs/binned.md."""
    with slot:  # the asset may have to be loaded onto the device
        return engine.tiles.bins(asset)


@router.get(
    "/{udim}/{level}/{row}/{column}",
    operation_id="getBinTile",
    response_class=Response,
    responses={**binary(NPY), **problems(404, 409, 422, 503, 507)},
    dependencies=[NoRepeats],
)
def tile(
    request: Request,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    asset: AssetId,
    udim: Udim,
    level: Level,
    row: Row,
    column: Column,
    query: Annotated[BinQuery, Query()],
) -> Response:
    """One tile of codes, int8 or int16, as .npy; times the manifest's step they are displacement,
    furrows negative; those of tilts are positions in the bin, from -1 to 1.

    A tile of T texels per side has T² codes; of `cushions` it has (T / factor + 2 apron)²: `apron`
    more samples on every side than the tile covers. So have `cushion_places` and `cushion_owners`;
    owners are int32, rows of the graph.

    Level 0 only: a coarser level is 404, for those of `binned` are means of its level 0.
    """
    address = TileAddress(udim, level, row, column)
    side = engine.assets.dimensions(asset).grid.tile_size
    with slot:
        hold = memory.answer(WORKING * WIDEST_CODE * side**2)
        codes = engine.tiles.bin_tile(asset, address, query.layer, query.bin, query.sample)
    body = npy(codes)
    hold.resize(len(body))
    return tagged(request, body, NPY)
