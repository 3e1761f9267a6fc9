"""Assets as files for other servers: out of the store, and into it."""

from __future__ import annotations

from typing_extensions import override

from rhytid.engine.assets.asset import AssetRegistry
from rhytid.engine.assets.stored import RestoredAssets
from rhytid.engine.messages import AssetInfo
from rhytid.engine.operations import Snapshots
from rhytid.engine.shared_assets import SharedAssets
from rhytid.storage.snapshots import Readable, Snapshot
from rhytid.storage.store import AssetStore


class SnapshotService(Snapshots):
    """Writes ready assets as files, and takes such files in; nothing is synthesised."""

    def __init__(
        self,
        registry: AssetRegistry,
        store: AssetStore,
        restored: RestoredAssets,
        shared: SharedAssets,
    ) -> None:
        self._assets, self._store = registry, store
        self._restored, self._shared = restored, shared

    @override
    def of(self, asset: str) -> Snapshot:
        self._assets.get(asset).check_ready()
        return self._store.snapshots.of(asset)

    @override
    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        with self._store.snapshots.unpacked(stream, nbytes) as unpacked:
            asset, new = self._restored.register(unpacked, self._store.snapshots.install)
            if new:
                self._shared.share(asset.id)
            return asset.info(), new
