"""Reads assets from the store: at startup, and when content is sent that was built before."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator
from functools import partial

from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.warnings import InputWarning
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.graphs import graph_lengths, mean_spacing
from rhytid.engine.assets.on_device import DAMAGED, DeviceAssets
from rhytid.engine.frames import FrameMemory
from rhytid.errors import SettingsError, StorageError, StoreFormatError, public_message
from rhytid.storage.asset_snapshots import UnpackedAsset
from rhytid.storage.records import BuildFacts, StoredAsset
from rhytid.storage.store import AssetStore

_log = logging.getLogger(__name__)


class StoredAssets:
    """Reads assets of a store; their parts on the device are loaded on first use."""

    def __init__(self, store: AssetStore, on_device: DeviceAssets, memory: FrameMemory) -> None:
        self._store, self._on_device, self._memory = store, on_device, memory

    def built(self, only: Collection[str] | None = None) -> Iterator[Asset]:
        """Every built asset, or those of `only`, ready; a damaged one as failed."""
        return map(self._opened, _among(self._store.ids(), only))

    def pending(self, only: Collection[str] | None = None) -> Iterator[Asset]:
        """Every asset that was sent and never finished, or those of `only`, building; a damaged one
        as failed."""
        for id in _among(self._store.pending(), only):
            try:
                request = self._store.request(id)
            except StorageError as error:
                yield self._damaged(id, error)
                continue
            unit, resolution = request.settings.length_unit, request.settings.resolution
            warnings = (*mesh_warnings(request.mesh, unit, resolution), *request.noted)
            yield Asset.of(
                id, request.mesh, request.settings, warnings, self._memory,
                partial(self._store.mesh, id),
            )  # fmt: skip

    def restore(self, asset: Asset) -> bool:
        """Make an asset that is sent again ready, where the store has it built; returns whether it
        has.

        A damaged asset is removed from the store, and so is a damaged request; damaged settings of
        an intact asset become those that it was built with. An asset of another version is left as
        it is: raises StoreFormatError.
        """
        if asset.id not in self._store.ids():
            self._check_request(asset.id)
            return False
        try:
            stored = self._store.asset(asset.id)
        except StoreFormatError:
            raise
        except StorageError as error:
            _log.error("asset %s is built anew: %s", asset.id, error)
            self._store.delete(asset.id)
            return False
        try:
            self._store.overlay(asset.id)
        except StoreFormatError:
            raise
        except StorageError as error:
            _log.error("asset %s has the settings that it was built with: %s", asset.id, error)
            self._store.put_overlay(asset.id, stored.settings)
        self.fill(asset, stored)
        return True

    def _check_request(self, id: str) -> None:
        """Remove a damaged request, so that another can take its place."""
        if id not in self._store.pending():
            return
        try:
            self._store.request(id)
        except StoreFormatError:
            raise
        except StorageError as error:
            _log.error("asset %s is asked for anew: %s", id, error)
            self._store.delete(id)

    def _opened(self, id: str) -> Asset:
        try:
            stored = self._store.asset(id)
            read = partial(self._store.mesh, id)
            asset = Asset.of(id, stored.mesh, stored.settings, (), self._memory, read)
            self.fill(asset, stored)
        except StorageError as error:
            return self._damaged(id, error)
        return asset

    def fill(self, asset: Asset, stored: StoredAsset) -> None:
        """Make an asset of the store ready, with what is known of it since it was built; raises
        StorageError where that cannot be read."""
        facts = BuildFacts.of(stored)
        settings = self._store.overlay(asset.id) or stored.settings
        try:
            asset.lengths = graph_lengths(stored.graph, settings, facts.spacing, facts.spacing)
        except SettingsError as error:
            raise StoreFormatError(f"asset {asset.id}: {error}") from error
        asset.warnings = _kept_warnings(stored, facts)
        if facts.uv_length:  # 0: it could not be found out then
            asset.measured_uv = facts.uv_length
        distance = self._measured(stored) if facts.distance is None else facts.distance
        resolved = settings.with_lengths(asset.lengths)
        asset.built(stored.graph, resolved, distance, stored.residual)

    def _measured(self, stored: StoredAsset) -> float:
        """Mean distance of the pores of an asset, stored by a version that did not keep it."""
        made = self._on_device.place(stored.mesh, stored.graph, stored.settings, stored.stiffness)
        self._on_device.give_up(made)
        return mean_spacing(stored.mesh, stored.graph, made.mesh.pore_triangle)

    def _damaged(self, id: str, error: StorageError) -> Asset:
        """A failed asset. The log names the damaged file; the reason for callers does not."""
        _log.error("asset %s: %s", id, error)
        reason = public_message(error) if isinstance(error, StoreFormatError) else DAMAGED
        return Asset.failed(id, reason, self._memory)


def _among(ids: list[str], only: Collection[str] | None) -> list[str]:
    return ids if only is None else [id for id in ids if id in only]


def _kept_warnings(stored: StoredAsset, facts: BuildFacts) -> tuple[InputWarning, ...]:
    """The warnings of a stored asset; found anew where a version stored it that kept none."""
    if facts.warnings is not None:
        return facts.warnings
    return mesh_warnings(stored.mesh, stored.settings.length_unit, stored.settings.resolution)


class RestoredAssets:
    """Puts unpacked assets into the store and registers them, ready; nothing is synthesised."""

    def __init__(self, registry: AssetRegistry, store: AssetStore, stored: StoredAssets) -> None:
        self._assets, self._store, self._stored = registry, store, stored

    def register(
        self, unpacked: UnpackedAsset, install: Callable[[UnpackedAsset], object]
    ) -> tuple[Asset, bool]:
        """The asset, and whether it is new here; one that is known and did not fail stays as it is.

        install: puts it into the store.
        """
        while True:
            known = self._assets.find(unpacked.id)
            if known is not None and known.state != "failed":
                return known, False
            made = self._asset(unpacked)
            with made.lock:
                if self._assets.replace(known, made):
                    return self._kept(made, known, unpacked, install), True

    def fill(self, asset: Asset, unpacked: UnpackedAsset) -> None:
        """Make a registered asset ready, whose lock is held and which is in the store by now."""
        self._stored.fill(asset, unpacked.asset)

    def _asset(self, unpacked: UnpackedAsset) -> Asset:
        stored = unpacked.asset
        read = partial(self._store.mesh, unpacked.id)
        memory = self._assets.frame_memory
        return Asset.of(unpacked.id, stored.mesh, stored.settings, (), memory, read)

    def _kept(
        self,
        asset: Asset,
        before: Asset | None,
        unpacked: UnpackedAsset,
        install: Callable[[UnpackedAsset], object],
    ) -> Asset:
        """The asset, stored and ready; on failure the one before it is registered again."""
        try:
            install(unpacked)
            self.fill(asset, unpacked)
        except BaseException:
            asset.state = "removed"
            self._assets.replace(asset, before)
            raise
        return asset
