"""A local store beside a shared one, and copies of assets between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import (
    NotFoundError,
    SharedDamageError,
    SnapshotError,
    StorageError,
    StoreFormatError,
)
from rhytid.storage.asset_snapshots import UnpackedAsset
from rhytid.storage.canonical import hashed
from rhytid.storage.homes import ASSET, OVERLAY
from rhytid.storage.records import read_overlay
from rhytid.storage.shared.shared_store import Report, SharedStore, manifest_digest
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
        """Whether an asset was not changed here since the shared store had it so, and all of its
        objects are there, which are not read. Another machine may have changed it there since."""
        return self.is_pushed(id) and self.shared.holds(id)

    def bring(self, id: str, report: Report) -> bool:
        """Have an asset here as it is in the shared store; False, and nothing is done, where it is
        here so, was changed here since, or is here alone. For a store that nobody uses meanwhile.

        Raises what `fetched` does.
        """
        here = self.has(id)
        if here and not self._is_newer(id):
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

    def newer(self, id: str) -> SnapshotIndex | None:
        """The manifest of an asset in the shared store, where another machine has changed it and
        this one has not since; None where both have the same, or this one has changed it. Raises
        NotFoundError where the asset was removed there."""
        if not self.is_pushed(id):
            return None
        there = self.shared.index(id)
        return None if there == self._snapshots.index(id) else there

    def newer_settings(self, there: SnapshotIndex) -> tuple[AssetSettings, bytes] | None:
        """The settings of an asset as the shared store has them, and the bytes of their file; None
        where another file than theirs differs from the one here."""
        here = self._snapshots.index(there.asset)
        if {**here.files, OVERLAY: None} != {**there.files, OVERLAY: None}:
            return None
        data = self.shared.read(there, OVERLAY)
        label, path = f"{ASSET} {there.asset}", Path(f"{self.shared}/{there.asset}/{OVERLAY}")
        return read_overlay(label, data, path), data

    def take_settings(self, there: SnapshotIndex, data: bytes) -> None:
        """Put the bytes of `newer_settings` into the local store: it then has what is there."""
        self._snapshots.put_overlay(there.asset, data)
        self._note(there)

    def digest(self, id: str) -> str:
        """SHA-256 of the manifest that an asset of the local store has as it is now."""
        return manifest_digest(self._snapshots.index(id).encode())

    def _is_newer(self, id: str) -> bool:
        try:
            return self.newer(id) is not None
        except NotFoundError:  # somebody removed it there
            return False

    def _note(self, index: SnapshotIndex) -> None:
        with suppress(NotFoundError):  # removed meanwhile
            self._snapshots.note_shared(index.asset, self._noted(index))

    def _noted(self, index: SnapshotIndex) -> bytes:
        digest = manifest_digest(index.encode())
        return hashed({"place": str(self.shared), "manifest": digest})
