"""Frames: positions of the deformed mesh, kept in memory under a name."""

from __future__ import annotations

from typing import Any

import numpy as np
from fastapi import APIRouter, Request, Response

from rhytid.api import schemas
from rhytid.api.accept import preferred
from rhytid.api.dependencies import (
    Allow,
    AssetId,
    CalibrationPositions,
    EngineDep,
    FormerDep,
    FrameName,
    FramePositions,
    JobPlace,
    Memory,
    NoQuery,
    Slot,
    Strict,
)
from rhytid.api.documentation import POSITIONS, binary, problems
from rhytid.api.encoding import NPY, RAW, WORKING, npy, npz
from rhytid.api.uploads import WIDEST_VERTEX
from rhytid.domain.mesh import add_centre
from rhytid.engine.frames import Frame

JSON = "application/json"
NPZ = "application/x-npz"
# Bytes of axes, ratios and folds of a triangle.
STRETCH = 28
router = APIRouter(prefix="/v1/assets/{asset}", tags=["frames"], dependencies=[NoQuery])


@router.get(
    "/frames",
    operation_id="listFrames",
    response_model=list[schemas.Frame],
    responses=problems(404, 409, 422, 503),
)
def listing(asset: AssetId, engine: EngineDep) -> Any:
    """Every frame of an asset, `neutral` among them."""
    return engine.frames.all(asset)


@router.put(
    "/frames/{frame}",
    operation_id="putFrame",
    response_model=schemas.Frame,
    responses=problems(404, 409, 413, 422, 503, 507),
    openapi_extra=POSITIONS,
)
def put(
    asset: AssetId,
    frame: FrameName,
    positions: FramePositions,
    engine: EngineDep,
    former: FormerDep,
    slot: Slot,
    allow: Allow,
    strict: Strict = False,
) -> Any:
    """Store positions under a name, replacing what was there; 507 where the memory for frames is
    full."""
    with slot:
        sent = Frame.of(positions)
        stored = engine.frames.put(asset, frame, sent, strict=strict, allow=allow)
    former.stored(asset, frame)
    return stored


@router.get(
    "/frames/{frame}",
    operation_id="getFrame",
    response_model=schemas.Frame,
    responses={200: {"content": {NPY: {}, RAW: {}}}, **problems(404, 406, 409, 422, 503, 507)},
)
def show(
    asset: AssetId,
    frame: FrameName,
    request: Request,
    engine: EngineDep,
    slot: Slot,
    memory: Memory,
    response: Response,
) -> Any:
    """A frame as JSON, or its positions with `Accept: application/x-npy` (or
    `application/octet-stream`, raw float32). The type of the highest weight is sent, a weight of 0
    means not this one.

    Positions are where they were sent; as .npy float64 where the asset has a `centre`.
    """
    wanted = preferred(request, (JSON, NPY, RAW))
    info = engine.frames.info(asset, frame)
    if wanted == JSON:
        response.headers["Vary"] = "Accept"
        return info
    about = engine.assets.dimensions(asset)
    with slot:  # the asset may have to be loaded onto the device
        memory.answer(WORKING * WIDEST_VERTEX * about.vertices)
        positions = add_centre(engine.frames.positions(asset, frame), np.array(about.centre))
    little = positions.astype(positions.dtype.newbyteorder("<"), copy=False)
    body = npy(little) if wanted == NPY else little.astype("<f4", copy=False).tobytes()
    return Response(body, headers={"Vary": "Accept"}, media_type=wanted)


@router.delete(
    "/frames/{frame}",
    operation_id="deleteFrame",
    status_code=204,
    response_model=None,
    responses=problems(404, 409, 422, 503),
)
def delete(asset: AssetId, frame: FrameName, engine: EngineDep, former: FormerDep) -> None:
    """Delete a frame; `neutral` cannot be deleted."""
    engine.frames.delete(asset, frame)
    former.deleted(asset, frame)


@router.get(
    "/frames/{frame}/stretch",
    operation_id="getStretch",
    response_class=Response,
    responses={**binary(NPZ), **problems(404, 409, 422, 503, 507)},
)
def stretch(
    asset: AssetId, frame: FrameName, engine: EngineDep, slot: Slot, memory: Memory
) -> Response:
    """`.npz` with axes (F, 2, 2), axes[f, i] = ŝᵢ, ratios (F, 2), unclamped, and folds (F,), the
    share that folds of the mesh take of negative log stretch."""
    triangles = engine.assets.dimensions(asset).triangles
    with slot:
        memory.answer(WORKING * STRETCH * triangles)
        found = engine.frames.stretch(asset, frame)
    return Response(npz(found), media_type=NPZ)


@router.put(
    "/calibration",
    operation_id="calibrateAsset",
    status_code=202,
    response_model=schemas.Job,
    responses=problems(404, 409, 413, 422, 503, 507),
    openapi_extra=POSITIONS,
)
def calibrate(
    place: JobPlace,
    asset: AssetId,
    positions: CalibrationPositions,
    engine: EngineDep,
    response: Response,
    allow: Allow,
    strict: Strict = False,
) -> Any:
    """Set `bins.r_max` from the stretch of the positions sent; answers with a job."""
    job = engine.assets.calibrate(asset, positions, strict=strict, allow=allow)
    place.take(job.id)
    response.headers["Location"] = f"/v1/jobs/{job.id}"
    return job
