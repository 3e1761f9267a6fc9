"""The assets that a replica has loaded: as the shared store has them, on first use; the least
recently used leave."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial

from rhytid.engine import local_copies
from rhytid.engine.messages import AssetInfo, FollowedAsset
from rhytid.engine.shared_calls import FORGOTTEN, RecentFailures
from rhytid.errors import (
    FetchingError,
    NotFoundError,
    SharedDamageError,
    SharedStoreError,
    StorageError,
)
from rhytid.fleet.envelopes import ElsewhereError
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_sync import FrameSync
from rhytid.processes.keyed_locks import KeyedLocks
from rhytid.processes.remote_engine import RemoteEngine

# Seconds to wait until nobody uses an asset any more, of which other files are there now.
PATIENCE = 60.0
# Under which it is remembered that the shared store could not be used.
_STORE = ""
_log = logging.getLogger(__name__)


@dataclass
class LoadedAsset:
    """An asset that the engine of this replica has, or builds.

    revision: of its manifest that the engine has followed; None: it was not shared yet.  upload:
    whether what was sent of it is kept.  users: calls that use it.  used, looked: when it was used
    last, and when its manifest was looked at, in seconds of `time.monotonic`.
    """

    revision: str | None = None
    upload: bool = False
    users: int = 0
    used: float = field(default_factory=time.monotonic)
    looked: float = float("-inf")


class LoadedAssets:
    """Sees that the engine has the asset of a call, and lets assets go.

    The engine does the work: it fetches, follows what others changed, and drops.  replica: its
    name.  most: assets that stay loaded.  resume: goes on with a build whose replica is gone.
    seen: an asset as callers see it.
    """

    def __init__(
        self,
        engine: RemoteEngine,
        store: FleetStore,
        frames: FrameSync,
        most: int,
        replica: str,
        resume: Callable[[str], None],
        seen: Callable[[AssetInfo], AssetInfo],
    ) -> None:
        self._engine, self._store, self._frames = engine, store, frames
        self._most, self._replica = most, replica
        self._resume, self._seen = resume, seen
        self._here: OrderedDict[str, LoadedAsset] = OrderedDict()
        self._locks = KeyedLocks()
        self._unused = threading.Condition()
        self._failures = RecentFailures(FORGOTTEN)

    def changing(self, asset: str) -> AbstractContextManager[None]:
        """Held while the asset in the shared store and the one here change together."""
        return self._locks.holding(asset)

    @contextmanager
    def using(self, asset: str, gone: str = "", *, mend: bool = False) -> Iterator[None]:
        """The engine has the asset in the block as the shared store has it, if it is there.

        gone: a replica that is known not to be there any more.  mend: what is damaged there is as
        if it were not there: the block replaces or removes it. Raises ElsewhereError where another
        replica builds the asset, SharedDamageError where it is damaged.
        """
        with self._locks.holding(asset):
            try:
                self._see_to(asset, gone)
            except SharedDamageError as error:
                if not mend:
                    raise
                _log.warning("%s; this call mends it", error)
            release = self.pin(asset)
            with self._unused:
                if self.has(asset):
                    self._here.move_to_end(asset)
                    self._here[asset].used = time.monotonic()
        try:
            yield
        finally:
            release()
            self._trim()

    def take(self, asset: str) -> None:
        """The engine builds the asset, and what was sent of it is kept."""
        with self._unused:
            self._here.setdefault(asset, LoadedAsset()).upload = True

    def see_changed(self, asset: str) -> None:
        """The engine has shared the asset, or changed it, and the shared store has that now; to be
        called while `changing` is held."""
        with suppress(SharedStoreError):  # the next call looks again
            there = self._revision(asset)
            found = self._engine.assets.follow(asset, replace=False)
            if found is not None:  # else the next call takes what another machine has changed
                self._note(asset, there, found)

    def pin(self, asset: str) -> Callable[[], None]:
        """Keep an asset here until what is returned is called."""
        with self._unused:
            pinned = self._here.get(asset) or LoadedAsset()
            pinned.users += 1
        return partial(self._release, pinned)

    def forget(self, asset: str) -> None:
        """The engine does not have the asset any more."""
        with self._unused:
            self._here.pop(asset, None)
        self._frames.forget(asset)

    def has(self, asset: str) -> bool:
        """Whether the engine has the asset, or builds it."""
        return asset in self._here

    def _release(self, used: LoadedAsset) -> None:
        with self._unused:
            used.users -= 1
            self._unused.notify_all()

    def _see_to(self, asset: str, gone: str) -> None:
        here = self._here.get(asset)
        if here is not None and time.monotonic() - here.looked < self._store.assets.fresh:
            return
        try:
            there = self._revision(asset)
            if here is None or here.revision != there:
                self._see_to_other(asset, there, gone)
            here = self._here.get(asset)
        except SharedStoreError:
            if here is None:  # else it is taken as it is here
                raise
        if here is not None:
            here.looked = time.monotonic()

    def _revision(self, asset: str) -> str | None:
        """As `SharedStore.revision`, which is not asked again at once where it could not be
        used."""
        self._failures.check(_STORE)
        try:
            return self._store.assets.revision(asset)
        except SharedStoreError as error:
            _log.warning("loaded assets are taken as they are here: %s", error)
            self._failures.add(_STORE, error)
            raise

    def _see_to_other(self, asset: str, there: str | None, gone: str) -> None:
        """Of an asset that is not here, or another in the shared store now."""
        if there is not None or self.has(asset):
            try:
                return self._follow(asset, there)
            except NotFoundError:
                self.forget(asset)
        self._see_to_upload(asset, gone)

    def _follow(self, asset: str, there: str | None) -> None:
        """Have the engine take what is in the shared store.  there: the revision that was seen of
        it: where it is another by now, it is followed again."""
        here = self._here.get(asset)
        found = self._engine.assets.follow(asset, replace=here is None or not here.users)
        if found is None:
            with self._unused:
                self._unused.wait_for(lambda: not (here and here.users), PATIENCE)
            found = self._engine.assets.follow(asset, replace=True)
            assert found is not None
        self._note(asset, there, found)

    def _note(self, asset: str, there: str | None, found: FollowedAsset) -> None:
        """The engine has followed a revision; what callers see of it is said in the shared
        store."""
        if found.replaced:
            self._frames.forget(asset)
        with self._unused:
            here = self._here.setdefault(asset, LoadedAsset())
            here.revision, here.looked = there, time.monotonic()
        if there is not None and here.upload:
            self._store.files.remove_upload(asset)
            here.upload = False
        with suppress(StorageError):  # without room there, it is loaded for lists
            if found.manifest and self._store.files.info(asset, found.manifest) is None:
                self._store.files.put_info(self._seen(found.info), found.manifest)

    def _see_to_upload(self, asset: str, gone: str) -> None:
        """Of an asset that is not built: go on where its replica is gone."""
        owner = self._store.files.owner(asset)
        if owner is not None and owner not in (gone, self._replica):
            raise ElsewhereError(owner)
        if owner is not None:
            _log.warning("the build of %s goes on here: replica %s is gone", asset, owner)
            self._resume(asset)

    def _trim(self) -> None:
        """Let the least recently used go that is not in use, where there are too many."""
        while len(self._here) > self._most:
            before = time.monotonic() - local_copies.RESTING
            with self._unused:
                idle = [
                    name
                    for name, one in self._here.items()
                    if not one.users and one.revision is not None and one.used <= before
                ]
            if not any(map(self._left, idle)):
                return

    def _left(self, asset: str) -> bool:
        """Let an asset go, where that is allowed; whether it went. Its frames go, too: the registry
        has them."""
        with self._locks.holding(asset):
            here = self._here.get(asset)
            if here is None or here.users or self._frames.only_here(asset):
                return False
            try:
                if not self._engine.assets.leave(asset):
                    return False
            except (SharedStoreError, FetchingError):
                return False
            self.forget(asset)
            return True
