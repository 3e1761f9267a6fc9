"""Assets as files for other servers: out of the store, and into it."""

from __future__ import annotations

from functools import partial

from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.assets import Asset
from rhytid.engine.messages import AssetInfo
from rhytid.engine.stored_assets import StoredAssets
from rhytid.storage.snapshots import Readable, Snapshot
from rhytid.storage.store import AssetStore
from rhytid.storage.unpacked import UnpackedAsset


class SnapshotService:
    """Writes ready assets as files, and takes such files in; nothing is synthesised."""

    def __init__(self, registry: AssetRegistry, store: AssetStore, stored: StoredAssets) -> None:
        self._assets, self._store, self._stored = registry, store, stored

    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""
        self._assets.get(asset).check_ready()
        return self._store.snapshot(asset)

    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """The asset of a snapshot of so many bytes, and whether it is new here.

        One that is known and did not fail stays as it is, its present settings too. Raises
        SnapshotError before anything is changed; StoreFormatError where another version stored it.
        """
        with self._store.unpacked(stream, nbytes) as unpacked:
            while True:
                known = self._assets.find(unpacked.id)
                if known is not None and known.state != "failed":
                    return known.info(), False
                made = self._asset(unpacked)
                with made.lock:
                    if self._assets.replace(known, made):
                        return self._kept(made, known, unpacked).info(), True

    def _asset(self, unpacked: UnpackedAsset) -> Asset:
        stored = unpacked.asset
        read = partial(self._store.mesh, unpacked.id)
        memory = self._assets.frame_memory
        return Asset.of(unpacked.id, stored.mesh, stored.settings, (), memory, read)

    def _kept(self, asset: Asset, before: Asset | None, unpacked: UnpackedAsset) -> Asset:
        """The asset, stored and ready; on failure the one before it is registered again."""
        try:
            self._store.install(unpacked)
            self._stored.fill(asset, unpacked.asset)
        except BaseException:
            asset.state = "removed"
            self._assets.replace(asset, before)
            raise
        return asset
