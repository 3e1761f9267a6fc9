"""Keeps the local copies of shared assets below a number of bytes."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import suppress

from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.jobs import Jobs
from rhytid.errors import NotFoundError, SharedStoreError, StorageError
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.store import AssetStore

# Seconds since its last use in which an asset stays: a call may still read its files.
RESTING = 5.0
_log = logging.getLogger(__name__)


class LocalRoom:
    """Drops assets from the local store, those used longest ago first, while it holds more than
    `limit` bytes of them; they are fetched again when they are used.

    An asset stays that was changed here and not pushed since, that the shared store has not whole,
    that has stored frames or unfinished jobs, or was used a moment ago.
    """

    def __init__(
        self,
        limit: int,
        mirror: StoreMirror,
        registry: AssetRegistry,
        store: AssetStore,
        on_device: DeviceAssets,
        jobs: Jobs,
    ) -> None:
        self._limit, self._mirror, self._assets = limit, mirror, registry
        self._store, self._on_device, self._jobs = store, on_device, jobs
        self._making = threading.Lock()

    def make(self) -> None:
        """Drop what may be dropped until the limit holds. What cannot be looked at stays, and so
        does all the rest where the shared store is away."""
        with self._making, suppress(SharedStoreError):
            sizes = {asset: self._size(asset) for asset in self._assets.all()}
            too_many = sum(sizes.values()) - self._limit
            for asset in sorted(sizes, key=lambda asset: asset.used):
                if too_many <= 0:
                    return
                if self._drop(asset):
                    too_many -= sizes[asset]

    def _size(self, asset: Asset) -> int:
        with suppress(StorageError, NotFoundError):
            return sum(file.nbytes for file in self._store.snapshots.index(asset.id).files.values())
        return 0

    def _drop(self, asset: Asset) -> bool:
        """Whether an asset could be dropped; raises SharedStoreError where that cannot be asked."""
        try:
            dropped = self._rests(asset) and self._mirror.is_held(asset.id) and self._leave(asset)
        except SharedStoreError:
            raise
        except (StorageError, NotFoundError):
            return False
        if dropped:
            self._on_device.drop(asset)
            _log.info("asset %s is in the shared store alone now", asset.id)
        return dropped

    def _leave(self, asset: Asset) -> bool:
        """Take an asset out of the local store, unless it is used or was changed meanwhile."""
        with asset.lock:
            if not (self._rests(asset) and self._mirror.is_pushed(asset.id)):
                return False
            if not asset.frames.leave():
                return False
            asset.state = "left"
            self._assets.replace(asset, None)
            self._store.delete(asset.id)
        return True

    def _rests(self, asset: Asset) -> bool:
        """Whether nobody uses a ready asset now, or did a moment ago."""
        at_work = any(not job.ended for job in self._jobs.of(asset.id))
        return asset.state == "ready" and not at_work and time.monotonic() - asset.used > RESTING
