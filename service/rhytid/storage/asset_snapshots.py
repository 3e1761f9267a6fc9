"""Snapshots of the assets of a store: made from its files, and stored again after checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import InputError, SnapshotError, StorageError, StoreFormatError
from rhytid.storage.folders import StoreFolders
from rhytid.storage.homes import ASSET, OVERLAY, REQUEST, SHAPES, SHARED, is_built
from rhytid.storage.manifest import StoredFile, read_manifest, read_verified
from rhytid.storage.records import (
    BuildFacts,
    StoredAsset,
    changed_settings,
    present_settings,
    read_overlay,
    read_shapes,
    write_overlay,
)
from rhytid.storage.snapshots import Readable, Snapshot, SnapshotIndex, unpack
from rhytid.support.atomic_files import (
    copy_file,
    is_folder,
    remove_tree,
    storage_errors,
    sync_folder,
)


class AssetSnapshots:
    """Makes snapshots of the built assets of a store, and stores assets from snapshots.

    delete: removes an asset from the store. Methods raise what those of `AssetStore` raise.
    """

    def __init__(self, folders: StoreFolders, delete: Callable[[str], None]) -> None:
        self._folders, self._delete = folders, delete

    def of(self, id: str, *, checked: bool = True) -> Snapshot:
        """The snapshot of a built asset, with its present settings and its named shapes; close it.

        checked: read every byte of it, and raise StorageError where a file is not what was written.
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
        """The index of the snapshot of a built asset; the arrays of the asset are not read."""
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
        """The asset whose files `write` puts into an empty folder, checked as by `unpacked`."""
        with storage_errors("a snapshot cannot be unpacked"), self._folders.workplace() as place:
            index = write(place)
            yield UnpackedAsset.read(index, place)

    def install(self, unpacked: UnpackedAsset, *, anew: bool = False) -> bool:
        """Store the asset of a snapshot; return whether anything was stored.

        An asset that is there intact is kept, unless `anew`. A damaged one is replaced, and a
        request for it is removed. Raises StoreFormatError where another version of rhytid stored
        it.
        """
        home = self._folders.home(unpacked.id)
        if not anew and _is_intact(home):
            return False
        with storage_errors(f"{ASSET} {unpacked.id} cannot be written"):
            if is_built(home):
                self._delete(unpacked.id)
            # A request stays until the asset is there: it may be the only copy.
            self._folders.discard(home / SHAPES, f"the shapes of asset {unpacked.id} stay")
            before = [OVERLAY, SHAPES] if unpacked.has_shapes else [OVERLAY]
            stored = self._folders.install(unpacked.place, home, ASSET, before)
            self._folders.discard(home / REQUEST, f"the request of asset {unpacked.id} stays")
            return stored

    def restore(self, path: Path) -> tuple[str, bool]:
        """Store the asset of a snapshot file; return its id, and whether it was stored.

        Raises SnapshotError as `unpacked` does, and StorageError where the file cannot be read.
        """
        with (
            storage_errors(f"{path} cannot be read"),
            path.open("rb") as file,
            self.unpacked(file, path.stat().st_size) as unpacked,
        ):
            return unpacked.id, self.install(unpacked)

    def with_own_shapes(self, unpacked: UnpackedAsset) -> UnpackedAsset:
        """The asset of a snapshot, not stored yet, with the named shapes that the store has for
        this asset; its own where the store has none."""
        own, place = self._folders.home(unpacked.id) / SHAPES, unpacked.place / SHAPES
        with storage_errors(f"the shapes of asset {unpacked.id} cannot be copied"):
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
        """Keep a note of the state in which a shared store has a built asset; it replaces an
        earlier note."""
        self._folders.replace(self._folders.existing(id, ASSET).parent / SHARED, note)

    def shared_note(self, id: str) -> bytes | None:
        """The note that `note_shared` kept; None where there is none."""
        path = self._folders.existing(id, ASSET).parent / SHARED
        with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError):
            return path.read_bytes()
        return None

    def _index(self, id: str) -> tuple[SnapshotIndex, bytes]:
        """The index of the snapshot of a built asset, and its overlay."""
        home = self._folders.existing(id, ASSET).parent
        overlay = write_overlay(f"{ASSET} {id}", present_settings(home))
        kinds = [ASSET, SHAPES] if is_folder(home / SHAPES) else [ASSET]
        files = {
            f"{kind}/{name}": file
            for kind in kinds
            for name, file in read_manifest(home / kind, f"{kind} {id}").items()
        }
        return SnapshotIndex.of(id, {**files, OVERLAY: StoredFile.of(overlay)}), overlay


@dataclass(frozen=True, eq=False)
class UnpackedAsset:
    """A built asset with its present settings, whose files are in the folder `place`, not stored
    yet.

    index: of its snapshot.  has_shapes: whether the folder holds named shapes of its mesh, too.
    """

    index: SnapshotIndex
    asset: StoredAsset
    settings: AssetSettings
    place: Path
    has_shapes: bool

    @property
    def id(self) -> str:
        """The id of the asset."""
        return self.index.asset

    @classmethod
    def read(cls, index: SnapshotIndex, place: Path) -> UnpackedAsset:
        """Read and check the files that `unpack` wrote; raises SnapshotError where they are no
        asset that can be drawn."""
        id = index.asset
        files = read_verified(place / ASSET, f"{ASSET} {id}")
        has_shapes = is_folder(place / SHAPES)
        shapes = read_verified(place / SHAPES, f"{SHAPES} {id}") if has_shapes else {}
        with storage_errors("a snapshot cannot be read"):
            overlay = (place / OVERLAY).read_bytes()
        try:
            # Places in the snapshot, not on this machine, are what errors name.
            asset = StoredAsset.read(files, Path(ASSET))
            settings = read_overlay(f"{ASSET} {id}", overlay, Path(OVERLAY))
            _check(asset, settings)
            if has_shapes:
                _check_shapes(read_shapes(shapes, Path(SHAPES)), asset)
        except (StorageError, SnapshotError) as exc:
            raise SnapshotError(f"what it holds cannot be used: {exc}") from exc
        return cls(index, asset, settings, place, has_shapes)


def _check(asset: StoredAsset, settings: AssetSettings) -> None:
    """Raise SnapshotError where the parts do not fit each other, or the present settings."""
    udims = mesh_udims(asset.mesh)
    if not udims:
        raise SnapshotError("no triangle of the mesh lies in a UDIM")
    if asset.residual is not None:
        try:
            asset.residual.check(udims, settings.resolution)
        except InputError as exc:
            raise SnapshotError(str(exc)) from exc
    triangles = len(asset.mesh.faces)
    for name in ("node_triangle", "edge_triangle"):
        index = getattr(asset.graph, name)
        if index is not None and len(index) and index.max() >= triangles:
            raise SnapshotError(f"{name} of the graph names a triangle that the mesh does not have")
    BuildFacts.of(asset)


def _check_shapes(shapes: Expressions, asset: StoredAsset) -> None:
    """Raise SnapshotError where shapes are of another mesh."""
    own, theirs = len(asset.mesh.positions), shapes.positions.shape[1]
    if own != theirs:
        raise SnapshotError(f"its shapes have {theirs} vertices each, its mesh has {own}")


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
