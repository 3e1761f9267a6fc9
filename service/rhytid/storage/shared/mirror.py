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
from rhytid.storage.canonical import hashed
from rhytid.storage.shared.shared_store import Report, SharedStore
from rhytid.storage.snapshot_index import SnapshotIndex
from rhytid.storage.store import AssetStore
from rhytid.storage.unpacked import UnpackedAsset


class StoreMirror:
    """Copies assets between a local store and a shared one.

    The local store notes of each asset in which state the shared one has it, so that what is to be
    pushed is known without asking.  shared: the shared store.
    """

    def __init__(self, store: AssetStore, shared: SharedStore) -> None:
        self._store, self.shared = store, shared

    def push(self, id: str, report: Report, *, anew: bool = False) -> bool:
        """Write a built asset with its present settings and named shapes to the shared store; False
        where it was there so. Raises what `SharedStore.push` and `AssetStore.snapshot` do."""
        with self._store.snapshot(id) as made:
            written = self.shared.push(made, report, anew=anew)
            self._note(made.index)
        return written

    def is_pushed(self, id: str) -> bool:
        """Whether the shared store was given an asset as it is now; somebody may have removed it
        since."""
        return self._store.shared_note(id) == self._noted(self._store.index(id))

    def is_held(self, id: str) -> bool:
        """Whether the shared store has an asset as it is now, with all of its objects; they are not
        read."""
        return self.shared.holds(self._store.index(id))

    @contextmanager
    def fetched(self, id: str, report: Report) -> Iterator[UnpackedAsset]:
        """An asset of the shared store, checked in full and not in the local one yet; see `take`.

        Raises what `SharedStore.fetch` does, and SharedDamageError where it is no asset that can be
        drawn.
        """
        with ExitStack() as opened:
            try:
                fetch = partial(self.shared.fetch, id, report=report)
                unpacked = opened.enter_context(self._store.unpacked_by(fetch))
            except SnapshotError as exc:
                kind: type[StorageError] = SharedDamageError
                if isinstance(exc.__cause__, StoreFormatError):
                    kind = StoreFormatError
                raise kind(f"asset {id} in {self.shared}: {exc}") from exc
            yield unpacked

    def take(self, unpacked: UnpackedAsset) -> bool:
        """Put what was fetched into the local store, as `AssetStore.install`; named shapes that
        were sent here meanwhile stay. Whether it is now as it is in the shared store."""
        self._store.install(self._store.with_own_shapes(unpacked))
        index = self._store.index(unpacked.id)
        if index != unpacked.index:
            return False
        self._note(index)
        return True

    def _note(self, index: SnapshotIndex) -> None:
        with suppress(NotFoundError):  # removed meanwhile
            self._store.note_shared(index.asset, self._noted(index))

    def _noted(self, index: SnapshotIndex) -> bytes:
        digest = hashlib.sha256(index.encode()).hexdigest()
        return hashed({"place": str(self.shared), "manifest": digest})
