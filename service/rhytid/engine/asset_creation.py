"""Creates assets from uploads: checks what was sent, registers it, and warns of it."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from functools import cache, partial

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.folds import Folds
from rhytid.domain.frame import counted_frame
from rhytid.domain.settings_changes import settings_changed
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.asset_registration import AssetRegistration, Positions
from rhytid.engine.assets import Asset
from rhytid.engine.byte_budget import Hold
from rhytid.engine.checked_upload import CheckedUpload
from rhytid.engine.device_assets import DeviceAssets
from rhytid.engine.frames import FrameMemory
from rhytid.engine.messages import NewAsset
from rhytid.engine.shared_assets import SharedAssets
from rhytid.errors import NotFoundError
from rhytid.pipeline.draw_limit import DrawLimit
from rhytid.pipeline.folds import measured_folds
from rhytid.storage.store import AssetStore
from rhytid.synthesis.fields.capacity_check import check_amount

Warnings = tuple[InputWarning, ...]


class AssetCreation:
    """Takes in what callers send of assets.

    memory: counts the frames of new ones.  limit: of how long the maps of a given graph take.
    """

    def __init__(
        self,
        registration: AssetRegistration,
        device: Device,
        on_device: DeviceAssets,
        store: AssetStore,
        shared: SharedAssets,
        memory: FrameMemory,
        limit: DrawLimit,
    ) -> None:
        self._registration, self._memory, self._limit = registration, memory, limit
        self._device, self._on_device = device, on_device
        self._store, self._shared = store, shared

    def take(
        self, new: NewAsset, strict: bool, allow: Collection[str], hold: Hold | None
    ) -> tuple[Asset, Warnings]:
        """The asset of what was sent, new or known, and warnings beside its own; raises what
        `AssetService.create` does."""
        check_codes(allow)
        upload = CheckedUpload.of(new, self._device.budget.limit, self._limit)
        made = cache(partial(upload.asset, self._memory))
        known, sent = self._registration.known(upload.id), upload.unused
        if upload.frames:
            sent = (*sent, *_frame_warnings(known or made(), upload.frames))
        if strict:
            refuse((*upload.warnings, *_changed(known, upload.settings), *sent), allow)
        asset = self._registration.register(upload, made, self._folds(upload), hold)
        if new.shapes is not None and new.shapes.named:
            self._keep_shapes(asset, new.shapes)
        return asset, (*_changed(asset, upload.settings), *sent)

    def _keep_shapes(self, asset: Asset, shapes: Expressions) -> None:
        """In place of those that came before, unless the build failed meanwhile: then nothing of
        the asset is kept."""
        with asset.kept(), suppress(NotFoundError):
            self._store.put_shapes(asset.id, shapes)
            if asset.state == "ready":
                self._shared.share(asset.id)

    def _folds(self, upload: CheckedUpload) -> Folds | None:
        """Where expressions fold the mesh of an asset that is not built yet; other tasks of the
        device run between the steps. Raises what `check_amount` does."""
        if upload.expressions is None or self._registration.known(upload.id) is not None:
            return None
        mesh, settings = upload.new.mesh, upload.settings
        folds = measured_folds(
            self._device, mesh, upload.expressions, settings.response.log_stretch_limit,
            settings.length_unit, lambda *_: None, self._on_device.run_patiently,
        )  # fmt: skip
        if folds is not None and folds.regions:
            memory = self._device.budget.limit
            check_amount(mesh, settings.graph, upload.new.controls, memory, folds)
        return folds


def _frame_warnings(asset: Asset, frames: Positions) -> Warnings:
    """About the frames that come with a mesh, by the names that they will have."""
    return tuple(
        warning
        for index, positions in enumerate(frames)
        for warning in asset.frame_warnings(positions, f"frame {counted_frame(index)}")
    )


def _changed(asset: Asset | None, sent: AssetSettings) -> Warnings:
    """Where the asset of the content that is sent has other settings by now."""
    if asset is None or asset.state == "failed":
        return ()
    return settings_changed(asset.id, asset.settings, sent, asset.lengths)
