"""Assets: a neutral mesh with its wrinkle graph and settings."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from rhytid.api.dependencies import (
    Allow,
    AssetId,
    DecoderDep,
    EngineDep,
    FormerDep,
    Gone,
    JobPlace,
    Json,
    Memory,
    MetricsDep,
    NoQuery,
    Parts,
    Shared,
    Slot,
    Strict,
)
from rhytid.api.documentation import ASSET_FORM, CHANGES, problems
from rhytid.api.multipart import Part
from rhytid.api.schemas import Asset
from rhytid.api.uploads import decode_json, require
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.scan import ScanSettings
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError, SettingsError
from rhytid.processes.decoding.decoder import Decoder

router = APIRouter(prefix="/v1/assets", tags=["assets"], dependencies=[NoQuery])


@router.post(
    "",
    operation_id="createAsset",
    status_code=202,
    response_model=Asset,
    responses={
        200: {"model": Asset, "description": "Known and built"},
        **problems(409, 413, 415, 422, 503, 507),
    },
    openapi_extra=ASSET_FORM,
)
def create(
    place: JobPlace,
    parts: Parts,
    engine: EngineDep,
    memory: Memory,
    metrics: MetricsDep,
    decoder: DecoderDep,
    former: FormerDep,
    gone: Gone,
    response: Response,
    allow: Allow,
    strict: Strict = False,
) -> Any:
    """Send a mesh; 202 while the build runs, 200 where the same content is already there."""
    hold = memory.hold("uploads")
    with metrics.figures.stage("decode"):
        new = new_asset(parts, decoder, hold, gone)
    asset = engine.assets.create(new, strict=strict, allow=allow, hold=hold)
    if new.frames is not None and len(new.frames):
        former.sent(asset.id)
    place.take(asset.job)
    response.status_code = 202 if asset.state == "building" else 200
    response.headers["Location"] = f"/v1/assets/{asset.id}"
    return asset


def new_asset(parts: dict[str, Part], decoder: Decoder, hold: Hold, gone: Gone) -> NewAsset:
    """Decode the parts of an upload; raises InputError, or one of its kinds, naming the part, and
    what `Decoder.read` does."""
    mesh = require(parts, "mesh")
    if not mesh.filename:
        raise InputError("part mesh has no filename: its extension names the format")
    settings = decode_json(parts["settings"].data, "part settings") if "settings" in parts else {}
    force = decode_json(parts["force"].data, "part force") if "force" in parts else False
    if not isinstance(force, bool):
        raise InputError(f"part force is {force!r}: must be true or false")
    scan = _scan_settings(settings, "scan" in parts)
    chosen = AssetSettings.parse(settings, beside=("scan",)).named_after(mesh.filename)
    file = mesh.spool.descriptor
    return decoder.read(parts, chosen, scan, force=force, hold=hold, gone=gone, file=file)


def _scan_settings(settings: Any, sent: bool) -> ScanSettings:
    """Take what settings say of a scan out of them.  sent: whether there is one. Raises
    SettingsError."""
    if not isinstance(settings, dict) or "scan" not in settings:
        return ScanSettings()
    if not sent:
        raise SettingsError("scan says how part scan is read, but there is no such part")
    return ScanSettings.parse(settings.pop("scan"))


@router.get("", operation_id="listAssets", response_model=list[Asset], responses=problems(422))
def listing(engine: EngineDep) -> Any:
    """Every asset."""
    return engine.assets.all()


@router.get(
    "/{asset}",
    operation_id="getAsset",
    response_model=Asset,
    responses=problems(404, 409, 422, 503),
)
def show(asset: AssetId, engine: EngineDep) -> Any:
    """One asset, with its settings resolved."""
    return engine.assets.info(asset)


@router.patch(
    "/{asset}",
    operation_id="updateAsset",
    response_model=Asset,
    responses=problems(404, 409, 413, 415, 422, 503, 507),
    openapi_extra=CHANGES,
)
def change(asset: AssetId, changes: Json, engine: EngineDep, slot: Slot) -> Any:
    """Change settings that need no new synthesis."""
    if not isinstance(changes, dict):
        raise InputError(f"body is a JSON {type(changes).__name__}: must be an object")
    with slot:
        return engine.assets.change(asset, changes)


@router.delete(
    "/{asset}",
    operation_id="deleteAsset",
    status_code=204,
    response_model=None,
    responses=problems(404, 409, 422, 503),
)
def delete(asset: AssetId, engine: EngineDep, former: FormerDep, shared: Shared = False) -> None:
    """Remove an asset, its frames and its files. In a shared store it stays, and is fetched from
    there when it is used again, unless `shared`."""
    engine.assets.delete(asset, shared=shared)
    former.removed(asset)
