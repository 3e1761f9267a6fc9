"""The assets that a replica has loaded: out of the shared folder on first use, the least recently
used leave."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial

from rhytid.engine.messages import AssetInfo
from rhytid.engine_process.keyed_locks import KeyedLocks
from rhytid.engine_process.remote_engine import RemoteEngine
from rhytid.errors import NotFoundError, SharedDamageError, SnapshotError, StorageError
from rhytid.fleet.envelopes import ElsewhereError
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.shared_folder import Revision, SharedFolder

# Seconds to wait until nobody uses an asset any more, whose snapshot is another now.
PATIENCE = 60.0
_log = logging.getLogger(__name__)


@dataclass
class LoadedAsset:
    """An asset of this replica.

    snapshot, settings: revisions that it has.  own: it is built here, and not shared yet; or it
    failed to build.  users: calls that use it.
    """

    snapshot: Revision = None
    settings: Revision = None
    own: bool = False
    users: int = 0


class LoadedAssets:
    """Loads assets, and lets them go.

    replica: its name.  most: assets that stay loaded.  resume: goes on with a build whose replica
    is gone.  seen: an asset as callers see it.
    """

    def __init__(
        self,
        engine: RemoteEngine,
        shared: SharedFolder,
        frames: FrameSync,
        most: int,
        replica: str,
        resume: Callable[[str], None],
        seen: Callable[[AssetInfo], AssetInfo],
    ) -> None:
        self._engine, self._shared, self._frames = engine, shared, frames
        self._most, self._replica = most, replica
        self._resume, self._seen = resume, seen
        self._here: OrderedDict[str, LoadedAsset] = OrderedDict()
        self._locks = KeyedLocks()
        self._unused = threading.Condition()

    def changing(self, asset: str) -> AbstractContextManager[None]:
        """Held while the asset in the shared folder and the one here change together."""
        return self._locks.holding(asset)

    @contextmanager
    def using(self, asset: str, gone: str = "", *, mend: bool = False) -> Iterator[None]:
        """The engine has the asset in the block as it is in the shared folder, if it is there.

        gone: a replica that is known not to be there any more.  mend: what is damaged in the folder
        is as if it were not there: the block replaces or removes it. Raises ElsewhereError where
        another replica builds the asset, SharedDamageError where it is damaged.
        """
        with self._locks.holding(asset):
            try:
                self._see_to(asset, gone)
            except SharedDamageError as error:
                if not mend:
                    raise
                _log.warning("%s; this call mends it", error)
                if self.has(asset):  # its snapshot is good
                    self._shared.remove_settings(asset)
            release = self.pin(asset)
            with self._unused:
                if self.has(asset):
                    self._here.move_to_end(asset)
        try:
            yield
        finally:
            release()
            self._trim()

    def take(self, asset: str, snapshot: Revision = None) -> None:
        """The engine has the asset now.  snapshot: the one in the shared folder; None: it is not
        shared yet."""
        with self._unused:
            known = self._here.setdefault(asset, LoadedAsset())
            known.own, known.snapshot = snapshot is None, snapshot

    def note_settings(self, asset: str, settings: Revision) -> None:
        """The engine has settings that were placed in the shared folder."""
        with self._unused:
            if asset in self._here:
                self._here[asset].settings = settings

    def describe(self, asset: str) -> None:
        """Say in the shared folder what the asset is that the engine has: lists need not load it
        then. Without room there, it is loaded for them."""
        here = self._here[asset]
        info = self._seen(self._engine.assets.info(asset))
        with suppress(StorageError):
            self._shared.put_info(info, (here.snapshot, here.settings))

    def pin(self, asset: str) -> Callable[[], None]:
        """Keep an asset here until what is returned is called."""
        with self._unused:
            pinned = self._here.get(asset) or LoadedAsset()
            pinned.users += 1
        return partial(self._release, pinned)

    def _release(self, used: LoadedAsset) -> None:
        with self._unused:
            used.users -= 1
            self._unused.notify_all()

    def forget(self, asset: str) -> None:
        """The asset is removed."""
        with self._unused:
            self._here.pop(asset, None)
        self._frames.forget(asset)

    def has(self, asset: str) -> bool:
        """Whether the engine has the asset."""
        return asset in self._here

    def _see_to(self, asset: str, gone: str) -> None:
        here, there = self._here.get(asset), self._shared.revision(asset)
        if there is None:
            if here is None or not here.own:
                self._see_to_upload(asset, gone)
        elif here is None or (here.snapshot != there and not here.own):
            self._load(asset)
        elif not here.own:
            self._see_to_settings(asset, here)

    def _see_to_upload(self, asset: str, gone: str) -> None:
        """Of an asset that is not built: go on where its replica is gone; forget it where it was
        removed."""
        owner = self._shared.owner(asset)
        if self.has(asset):
            self._let_go(asset)
        if owner is not None and owner not in (gone, self._replica):
            raise ElsewhereError(owner)
        if owner is not None:
            _log.warning("the build of %s goes on here: replica %s is gone", asset, owner)
            self._resume(asset)

    def _load(self, asset: str) -> None:
        if self.has(asset):
            self._let_go(asset)
        revision = self._shared.revision(asset)
        with suppress(FileNotFoundError), self._shared.open_snapshot(asset) as file:
            nbytes = file.seek(0, 2)
            file.seek(0)
            try:
                self._engine.snapshots.restore(file, nbytes)
            except SnapshotError as error:
                text = f"asset {asset} is damaged in the shared folder: {error}"
                raise SharedDamageError(text) from error
            here = LoadedAsset(snapshot=revision)
            self._here[asset] = here
            self._see_to_settings(asset, here)
            if self._shared.info(asset, (here.snapshot, here.settings)) is None:
                self.describe(asset)

    def _see_to_settings(self, asset: str, here: LoadedAsset) -> None:
        revision = self._shared.settings_revision(asset)
        if revision != here.settings:
            settings = self._shared.settings(asset)
            if settings:
                self._engine.assets.change(asset, settings)
            here.settings = revision

    def _let_go(self, asset: str) -> None:
        """Remove an asset from the engine, once nobody uses it."""
        here = self._here[asset]
        with self._unused:
            self._unused.wait_for(lambda: not here.users, PATIENCE)
            self._here.pop(asset, None)
        with suppress(NotFoundError):
            self._engine.assets.delete(asset)
        self._frames.forget(asset)

    def _trim(self) -> None:
        """Let the least recently used go that is not in use, where there are too many."""
        while len(self._here) > self._most:
            with self._unused:
                idle = (name for name, one in self._here.items() if not one.users and not one.own)
                oldest = next((one for one in idle if not self._frames.only_here(one)), None)
            if oldest is None:
                return
            with self._locks.holding(oldest):
                here = self._here.get(oldest)
                if here is None or here.users or here.own:
                    return
                self._let_go(oldest)
