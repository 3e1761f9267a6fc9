"""Registers assets that were unpacked: of a snapshot, or of a shared store."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.stored import StoredAssets
from rhytid.storage.asset_snapshots import UnpackedAsset
from rhytid.storage.store import AssetStore


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
