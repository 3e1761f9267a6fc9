"""The assets of a store as snapshots: out of it, and into it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from rhytid.durable import copy_file, is_folder, remove_tree, reported, sync_folder
from rhytid.errors import StorageError, StoreFormatError
from rhytid.storage.folders import StoreFolders
from rhytid.storage.homes import ASSET, OVERLAY, REQUEST, SHAPES, SHARED, is_built
from rhytid.storage.manifest import StoredFile, read_manifest, read_verified
from rhytid.storage.overlays import changed_settings, present_settings, write_overlay
from rhytid.storage.records import StoredAsset
from rhytid.storage.snapshot_index import SnapshotIndex
from rhytid.storage.snapshots import Readable, Snapshot, unpack
from rhytid.storage.unpacked import UnpackedAsset


class AssetSnapshots:
    """Makes snapshots of the built assets of a store, and takes assets in from them.

    delete: removes an asset from the store. Methods raise what those of `AssetStore` do.
    """

    def __init__(self, folders: StoreFolders, delete: Callable[[str], None]) -> None:
        self._folders, self._delete = folders, delete

    def of(self, id: str, *, checked: bool = True) -> Snapshot:
        """A built asset with its present settings and its named shapes as one file; close it.

        checked: read every byte of it, and raise StorageError where one is not what was written.
        """
        home = self._folders.existing(id, ASSET).parent
        with self._folders.unchanged():  # shapes are replaced in two steps
            index, overlay = self._index(id)
            paths = {name: home / name for name in index.files if name != OVERLAY}
            made = Snapshot(index, paths, overlay)
        try:
            if checked:
                made.check()
        except BaseException:
            made.close()
            raise
        return made

    def has(self, id: str) -> bool:
        """Whether the store has a built asset of that id."""
        return is_built(self._folders.home(id))

    def index(self, id: str) -> SnapshotIndex:
        """What the snapshot of a built asset begins with; its arrays are not read."""
        with self._folders.unchanged():
            return self._index(id)[0]

    @contextmanager
    def unpacked(self, stream: Readable, nbytes: int) -> Iterator[UnpackedAsset]:
        """The asset of a snapshot of so many bytes, checked in full and stored nowhere yet; see
        `install`. Raises SnapshotError naming what is wrong with it, and where."""
        with self.unpacked_by(lambda place: unpack(stream, nbytes, place)) as unpacked:
            yield unpacked

    @contextmanager
    def unpacked_by(self, write: Callable[[Path], SnapshotIndex]) -> Iterator[UnpackedAsset]:
        """As `unpacked`, of an asset whose files `write` writes into an empty folder, as `unpack`
        does."""
        with reported("a snapshot cannot be unpacked"), self._folders.workplace() as place:
            index = write(place)
            yield UnpackedAsset.read(index, place)

    def install(self, unpacked: UnpackedAsset, *, anew: bool = False) -> bool:
        """Store the asset of a snapshot; False, and nothing is changed, where it is there intact,
        unless `anew`.

        One that is damaged is replaced, a request for it is removed. Raises StoreFormatError where
        another version of rhytid stored it.
        """
        home = self._folders.home(unpacked.id)
        if not anew and _is_intact(home):
            return False
        with reported(f"{ASSET} {unpacked.id} cannot be written"):
            if is_built(home):
                self._delete(unpacked.id)
            # A request stays until the asset is there: it may be the only copy.
            self._folders.discard(home / SHAPES, f"the shapes of asset {unpacked.id} stay")
            before = [OVERLAY, SHAPES] if unpacked.has_shapes else [OVERLAY]
            stored = self._folders.install(unpacked.place, home, ASSET, before)
            self._folders.discard(home / REQUEST, f"the request of asset {unpacked.id} stays")
            return stored

    def restore(self, path: Path) -> tuple[str, bool]:
        """Store the asset of a snapshot file; its id, and what `install` answers. Raises
        SnapshotError as `unpacked` does, and StorageError where the file cannot be read."""
        with (
            reported(f"{path} cannot be read"),
            path.open("rb") as file,
            self.unpacked(file, path.stat().st_size) as unpacked,
        ):
            return unpacked.id, self.install(unpacked)

    def with_own_shapes(self, unpacked: UnpackedAsset) -> UnpackedAsset:
        """The asset of a snapshot, not stored yet, with the named shapes that the store has for it,
        if any, in place of its own."""
        own, place = self._folders.home(unpacked.id) / SHAPES, unpacked.place / SHAPES
        with reported(f"the shapes of asset {unpacked.id} cannot be copied"):
            if not is_folder(own):
                return unpacked
            if unpacked.has_shapes:
                remove_tree(place)
            place.mkdir()
            for file in own.iterdir():
                copy_file(file, place / file.name)
            sync_folder(place)
        return replace(unpacked, has_shapes=True)

    def put_overlay(self, id: str, data: bytes) -> None:
        """Replace the present settings of a built asset by the bytes of their file."""
        self._folders.replace(self._folders.existing(id, ASSET).parent / OVERLAY, data)

    def note_shared(self, id: str, note: bytes) -> None:
        """Keep a note of what a shared store has of a built asset, in place of another."""
        self._folders.replace(self._folders.existing(id, ASSET).parent / SHARED, note)

    def shared_note(self, id: str) -> bytes | None:
        """The note of `note_shared`; None where there is none."""
        path = self._folders.existing(id, ASSET).parent / SHARED
        with reported(f"{path} cannot be read"), suppress(FileNotFoundError):
            return path.read_bytes()
        return None

    def _index(self, id: str) -> tuple[SnapshotIndex, bytes]:
        """Of a snapshot, with its overlay."""
        home = self._folders.existing(id, ASSET).parent
        overlay = write_overlay(f"{ASSET} {id}", present_settings(home))
        kinds = [ASSET, SHAPES] if is_folder(home / SHAPES) else [ASSET]
        files = {
            f"{kind}/{name}": file
            for kind in kinds
            for name, file in read_manifest(home / kind, f"{kind} {id}").items()
        }
        return SnapshotIndex.of(id, {**files, OVERLAY: StoredFile.of(overlay)}), overlay


def _is_intact(home: Path) -> bool:
    """Whether there is a built asset that can be read, with its settings."""
    folder = home / ASSET
    try:
        if not is_folder(folder):
            return False
        StoredAsset.read(read_verified(folder, f"{ASSET} {home.name}"), folder)
        changed_settings(home)
    except StoreFormatError:
        raise
    except StorageError:
        return False
    return True
