"""The local copies of shared assets: which may leave, and when they have to."""

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


class LocalCopies:
    """Drops assets from the local store; they are fetched again when they are used.

    An asset stays that was changed here and not pushed since, that the shared store has not whole,
    that has stored frames or unfinished jobs, or was used a moment ago.  limit: bytes of all
    copies, beyond which those used longest ago leave; None = any.
    """

    def __init__(
        self,
        limit: int | None,
        mirror: StoreMirror,
        registry: AssetRegistry,
        store: AssetStore,
        on_device: DeviceAssets,
        jobs: Jobs,
    ) -> None:
        self.limit, self._mirror, self._assets = limit, mirror, registry
        self._store, self._on_device, self._jobs = store, on_device, jobs
        self._making = threading.Lock()

    def make_room(self) -> None:
        """Drop assets that may be dropped until the limit holds. An asset that cannot be read
        stays, and so do all others where the shared store is away."""
        if self.limit is None:
            return
        with self._making, suppress(SharedStoreError):
            sizes = {asset: self._size(asset) for asset in self._assets.all()}
            too_many = sum(sizes.values()) - self.limit
            for asset in sorted(sizes, key=lambda asset: asset.used):
                if too_many <= 0:
                    return
                if self.leave(asset):
                    too_many -= sizes[asset]

    def leave(self, asset: Asset, *, with_frames: bool = False) -> bool:
        """Drop an asset, if it may be dropped; whether it was. with_frames: somebody else has its
        frames. Raises SharedStoreError where the shared store cannot be asked."""
        try:
            dropped = (
                self._rests(asset)
                and self._mirror.is_held(asset.id)
                and self._left(asset, with_frames)
            )
        except SharedStoreError:
            raise
        except (StorageError, NotFoundError):
            return False
        if dropped:
            _log.info("asset %s is in the shared store alone now", asset.id)
        return dropped

    def take_out(self, asset: Asset) -> None:
        """Take an asset, whose lock is held, and its frames out of the local store and from the
        device: it will be another object here."""
        asset.frames.leave(anyway=True)
        asset.state = "left"
        self._assets.replace(asset, None)
        self._store.delete(asset.id)
        self._on_device.drop(asset)

    def _size(self, asset: Asset) -> int:
        with suppress(StorageError, NotFoundError):
            return sum(file.nbytes for file in self._store.snapshots.index(asset.id).files.values())
        return 0

    def _left(self, asset: Asset, with_frames: bool) -> bool:
        """Take an asset out, unless it is used or was changed meanwhile."""
        # Not waited for: its holder may wait for a push, which may be what asks here.
        if not asset.lock.acquire(blocking=False):
            return False
        try:
            if not (self._rests(asset) and self._mirror.is_pushed(asset.id)):
                return False
            if not asset.frames.leave(anyway=with_frames):
                return False
            self.take_out(asset)
        finally:
            asset.lock.release()
        return True

    def _rests(self, asset: Asset) -> bool:
        """Whether nobody uses a ready asset now, or did a moment ago."""
        at_work = any(not job.ended for job in self._jobs.of(asset.id))
        return asset.state == "ready" and not at_work and time.monotonic() - asset.used > RESTING
