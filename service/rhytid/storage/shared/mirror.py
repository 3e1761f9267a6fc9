"""A local store beside a shared one: what the one has of the other."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial

from rhytid.errors import (
    NotFoundError,
    SharedDamageError,
    SnapshotError,
    StorageError,
    StoreFormatError,
)
from rhytid.storage.asset_snapshots import UnpackedAsset
from rhytid.storage.canonical import hashed
from rhytid.storage.shared.shared_store import Report, SharedStore
from rhytid.storage.snapshots import SnapshotIndex
from rhytid.storage.store import AssetStore


class StoreMirror:
    """Copies assets between a local store and a shared one.

    The local store notes of each asset in which state the shared one has it, so that what is to be
    pushed is known without asking.  shared: the shared store.
    """

    def __init__(self, store: AssetStore, shared: SharedStore) -> None:
        self._snapshots, self.shared = store.snapshots, shared

    def push(self, id: str, report: Report, *, anew: bool = False) -> bool:
        """Write a built asset with its present settings and named shapes to the shared store.

        False, and nothing is written, where it was not changed here since they had the same, and is
        there: what another machine has changed meanwhile stays.  anew: write all of it. Raises what
        `SharedStore.push` and `AssetSnapshots.of` do.
        """
        with suppress(SharedDamageError):
            if not anew and self.is_held(id):
                return False
        with self._snapshots.of(id, checked=False) as made:
            written = self.shared.push(made, report, anew=anew)
            self._note(made.index)
        return written

    def is_pushed(self, id: str) -> bool:
        """Whether an asset was not changed here since the shared store had it so; somebody may have
        changed or removed it there."""
        return self._snapshots.shared_note(id) == self._noted(self._snapshots.index(id))

    def is_held(self, id: str) -> bool:
        """Whether an asset was not changed here since the shared store had it so, and is there with
        all of its objects, which are not read: so, or as another machine changed it since."""
        return self.is_pushed(id) and self.shared.holds(id)

    def bring(self, id: str, report: Report) -> bool:
        """Have an asset here as it is in the shared store; False, and nothing is done, where it is
        here so, was changed here since, or is here alone. For a store that nobody uses meanwhile.

        Raises what `fetched` does.
        """
        here = self.has(id)
        if here and not self._is_other_there(id):
            return False
        with self.fetched(id, report) as unpacked:
            if here:
                self._snapshots.install(unpacked, anew=True)
                self._note(unpacked.index)
            else:
                self.take(unpacked)
        return True

    def has(self, id: str) -> bool:
        """Whether an asset is here."""
        return self._snapshots.has(id)

    @contextmanager
    def fetched(self, id: str, report: Report) -> Iterator[UnpackedAsset]:
        """An asset of the shared store, checked in full and not in the local one yet; see `take`.

        Raises what `SharedStore.fetch` does, and SharedDamageError where it is no asset that can be
        drawn.
        """
        with ExitStack() as opened:
            try:
                fetch = partial(self.shared.fetch, id, report=report)
                unpacked = opened.enter_context(self._snapshots.unpacked_by(fetch))
            except SnapshotError as exc:
                kind: type[StorageError] = SharedDamageError
                if isinstance(exc.__cause__, StoreFormatError):
                    kind = StoreFormatError
                raise kind(f"asset {id} in {self.shared}: {exc}") from exc
            yield unpacked

    def take(self, unpacked: UnpackedAsset) -> bool:
        """Put what was fetched into the local store, as `AssetSnapshots.install`; named shapes that
        were sent here meanwhile stay. Whether it is now as it is in the shared store."""
        self._snapshots.install(self._snapshots.with_own_shapes(unpacked))
        index = self._snapshots.index(unpacked.id)
        if index != unpacked.index:
            return False
        self._note(index)
        return True

    def _is_other_there(self, id: str) -> bool:
        """Whether another machine has changed an asset in the shared store, and this one has not
        changed it since they had the same."""
        try:
            return self.is_pushed(id) and self.shared.index(id) != self._snapshots.index(id)
        except NotFoundError:  # somebody removed it there
            return False

    def _note(self, index: SnapshotIndex) -> None:
        with suppress(NotFoundError):  # removed meanwhile
            self._snapshots.note_shared(index.asset, self._noted(index))

    def _noted(self, index: SnapshotIndex) -> bytes:
        digest = hashlib.sha256(index.encode()).hexdigest()
        return hashed({"place": str(self.shared), "manifest": digest})
