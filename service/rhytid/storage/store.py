"""The asset store.

::

    store/
    ├── lock                       held while a server uses the store
    ├── format.json                of which version of rhytid the store is
    ├── cache/                     compiled kernels, where `serve` has no other place for them
    ├── packages/<id>/             skin packages of an asset, one zip each; they go with its
    │                              settings, shapes or itself, or for the room of others
    ├── partial/                   changes being prepared or thrown away; emptied on opening
    └── assets/<id>/
        ├── request/               what a caller sent, until the asset is built: a sealed folder
        ├── asset/                 the built asset, never changed: a sealed folder
        ├── shapes/                named shapes of its mesh, if any came: a sealed folder
        ├── overlay.json           the present settings, replaced as a whole
        └── shared.json            in which state a shared store was given it, if one was
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.controls import Controls
from rhytid.domain.expressions import Expressions
from rhytid.domain.folds import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.durable import is_folder, remove_tree, reported
from rhytid.errors import NotFoundError, StorageError, StoreFormatError
from rhytid.storage.canonical import damaged
from rhytid.storage.folders import StoreFolders
from rhytid.storage.homes import (
    ASSET,
    REQUEST,
    SHAPES,
    SHARED,
    holds_something,
    is_built,
    is_readable,
    is_requested,
)
from rhytid.storage.kept_shapes import read_shapes, shape_files
from rhytid.storage.manifest import (
    StoredFile,
    read_file,
    read_manifest,
    read_verified,
)
from rhytid.storage.packages import KeptPackages
from rhytid.storage.records import (
    FACTS,
    MESH,
    StoredAsset,
    StoredRequest,
    decode_mesh,
    decode_settings,
    must_have_overlay,
    read_overlay,
    write_overlay,
)
from rhytid.storage.snapshot_index import OVERLAY, SnapshotIndex
from rhytid.storage.snapshots import Readable, Snapshot, unpack
from rhytid.storage.unpacked import UnpackedAsset


class AssetStore:
    """Assets in a folder, for one process at a time; safe to call from several threads.

    Each change happens at one rename: after a crash the store holds the state before it or the
    state after it. Opening takes the lock and removes what interrupted changes left behind.

    lock: False: another process, which started this one, holds the lock; several may then use the
    store, each with assets of its own.  packages: bytes of the skin packages that are kept; None:
    any.

    Every method raises StorageError where the disk fails or a file is not what was written, and
    NotFoundError for an id that is not stored.
    """

    def __init__(self, folder: Path, *, lock: bool = True, packages: int | None = None) -> None:
        self._folders = StoreFolders(folder, lock=lock)
        self.packages = KeptPackages(folder / "packages", self._folders.partial, packages)
        if not lock:
            return
        try:
            self.packages.sweep([home.name for home in self._folders.homes()])
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the lock of the store."""
        self._folders.close()

    def __enter__(self) -> AssetStore:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def ids(self) -> list[str]:
        """Ids of the built assets, ascending; one that is damaged, or whose folder cannot be read,
        is listed and raises when read."""
        return [
            home.name for home in self._folders.homes() if not is_readable(home) or is_built(home)
        ]

    def pending(self) -> list[str]:
        """Ids that were requested and are not built yet, ascending."""
        waiting = (
            home for home in self._folders.homes() if is_readable(home) and is_requested(home)
        )
        return [home.name for home in waiting if not is_built(home)]

    def put_request(
        self,
        id: str,
        mesh: Mesh,
        settings: AssetSettings,
        graph: WrinkleGraph | None,
        stiffness: Stiffness | None = None,
        controls: Controls | None = None,
        folds: Folds | None = None,
    ) -> None:
        """Store what a caller sent until the asset is built; nothing is changed for an id that is
        there."""
        home = self._folders.home(id)
        if not holds_something(home):
            request = StoredRequest(mesh, settings, graph, stiffness, controls, folds)
            self._folders.seal(home, REQUEST, request.files())

    def request(self, id: str) -> StoredRequest:
        """What a caller sent for an asset that is not built yet."""
        folder = self._folders.existing(id, REQUEST)
        return StoredRequest.read(read_verified(folder, f"{REQUEST} {id}"), folder)

    def put_asset(
        self,
        id: str,
        mesh: Mesh,
        graph: WrinkleGraph,
        settings: AssetSettings,
        extra: Mapping[str, Any],
        stiffness: Stiffness | None = None,
    ) -> None:
        """Store a built asset with an overlay of its settings, and remove its request.

        `settings` are resolved; `extra` is a JSON object. Raises StorageError where the asset is
        there already: it does not change, only `delete` removes it.
        """
        home = self._folders.home(id)
        asset = StoredAsset(mesh, graph, settings, dict(extra), stiffness)
        overlay = write_overlay(f"asset {id}", settings)
        if not self._folders.seal(home, ASSET, asset.files(), {OVERLAY: overlay}):
            raise StorageError(f"asset {id} is stored already, and stored assets do not change")
        self._folders.discard(home / REQUEST, f"the request of asset {id} cannot be removed")

    def asset(self, id: str) -> StoredAsset:
        """A built asset, every byte of it verified."""
        folder = self._folders.existing(id, ASSET)
        return StoredAsset.read(read_verified(folder, f"{ASSET} {id}"), folder)

    def mesh(self, id: str) -> Mesh:
        """The mesh of an asset, built or not; nothing else of it is read."""
        kind = ASSET if is_built(self._folders.home(id)) else REQUEST
        folder = self._folders.existing(id, kind)
        return decode_mesh(read_file(folder, f"{kind} {id}", MESH), folder / MESH)

    def put_shapes(self, id: str, shapes: Expressions) -> None:
        """Keep the named shapes of an asset that is built or requested, in place of others.

        Where they are there as they are, nothing is written.
        """
        home, files = self._folders.home(id), shape_files(shapes)
        if not holds_something(home):
            raise NotFoundError(f"no asset {id} in the store")
        with suppress(StorageError, NotFoundError):
            if read_verified(self._folders.existing(id, SHAPES), f"{SHAPES} {id}") == files:
                return
        self._folders.discard(home / SHAPES, f"the shapes of asset {id} cannot be replaced")
        self._folders.seal(home, SHAPES, files)
        self.packages.forget(id)

    def shapes(self, id: str) -> Expressions:
        """The named shapes of an asset; raises NotFoundError where it has none."""
        folder = self._folders.existing(id, SHAPES)
        return read_shapes(read_verified(folder, f"{SHAPES} {id}"), folder)

    def shapes_nbytes(self, id: str) -> int:
        """Bytes of the named shapes of an asset; only the manifest is read. Raises NotFoundError
        where it has none."""
        files = read_manifest(self._folders.existing(id, SHAPES), f"{SHAPES} {id}")
        return sum(file.nbytes for file in files.values())

    def shapes_digests(self, id: str) -> dict[str, str]:
        """Digests of the files of its named shapes, by name; none where it has none."""
        try:
            files = read_manifest(self._folders.existing(id, SHAPES), f"{SHAPES} {id}")
        except NotFoundError:
            return {}
        return {name: file.sha256 for name, file in files.items()}

    def contents(self, id: str) -> dict[str, StoredFile]:
        """Sizes and digests of the files of a built asset, as they were written; only the manifest
        is read."""
        return read_manifest(self._folders.existing(id, ASSET), f"{ASSET} {id}")

    def snapshot(self, id: str) -> Snapshot:
        """A built asset with its present settings and its named shapes as one file, every byte of
        it verified; close it."""
        home = self._folders.existing(id, ASSET).parent
        with self._folders.unchanged():  # shapes are replaced in two steps
            index, overlay = self._index(id)
            paths = {name: home / name for name in index.files if name != OVERLAY}
            made = Snapshot(index, paths, overlay)
        try:
            made.check()
        except BaseException:
            made.close()
            raise
        return made

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

    def install(self, unpacked: UnpackedAsset) -> bool:
        """Store the asset of a snapshot; False, and nothing is changed, where it is there intact.

        One that is damaged is replaced, a request for it is removed. Raises StoreFormatError where
        another version of rhytid stored it.
        """
        if self._is_intact(unpacked.id):
            return False
        home = self._folders.home(unpacked.id)
        with reported(f"{ASSET} {unpacked.id} cannot be written"):
            if holds_something(home):
                self.delete(unpacked.id)
            before = [OVERLAY, SHAPES] if unpacked.has_shapes else [OVERLAY]
            return self._folders.install(unpacked.place, home, ASSET, before)

    def with_own_shapes(self, unpacked: UnpackedAsset) -> UnpackedAsset:
        """The asset of a snapshot, not stored yet, with the named shapes that the store has for it,
        if any, in place of its own."""
        own, place = self._folders.home(unpacked.id) / SHAPES, unpacked.place / SHAPES
        with reported(f"the shapes of asset {unpacked.id} cannot be copied"):
            if not is_folder(own):
                return unpacked
            if unpacked.has_shapes:
                remove_tree(place)
            shutil.copytree(own, place)
        return replace(unpacked, has_shapes=True)

    def note_shared(self, id: str, note: bytes) -> None:
        """Keep a note of what a shared store has of a built asset, in place of another."""
        self._folders.replace(self._folders.existing(id, ASSET).parent / SHARED, note)

    def shared_note(self, id: str) -> bytes | None:
        """The note of `note_shared`; None where there is none."""
        path = self._folders.existing(id, ASSET).parent / SHARED
        with reported(f"{path} cannot be read"), suppress(FileNotFoundError):
            return path.read_bytes()
        return None

    def put_overlay(self, id: str, settings: AssetSettings) -> None:
        """Replace the present settings of a built asset."""
        path = self._folders.existing(id, ASSET).parent / OVERLAY
        self._folders.replace(path, write_overlay(f"asset {id}", settings))
        self.packages.forget(id)

    def overlay(self, id: str) -> AssetSettings | None:
        """The present settings, or None of an asset of an older version that never changed."""
        folder = self._folders.existing(id, ASSET)
        path = folder.parent / OVERLAY
        with reported(f"{path} cannot be read"), suppress(FileNotFoundError):
            return read_overlay(f"asset {id}", path.read_bytes(), path)
        facts = folder / FACTS
        with reported(f"{facts} cannot be read"):
            if must_have_overlay(facts.read_bytes(), facts):
                raise damaged(path, "the file is missing")
        return None

    def delete(self, id: str) -> None:
        """Remove an asset, its request and its changed settings, all at once."""
        self._folders.remove(id)
        self.packages.forget(id)

    def _index(self, id: str) -> tuple[SnapshotIndex, bytes]:
        """Of a snapshot, with its overlay."""
        folder = self._folders.existing(id, ASSET)
        overlay = write_overlay(f"{ASSET} {id}", self.overlay(id) or self._settings(folder, id))
        kinds = [ASSET, SHAPES] if is_folder(folder.parent / SHAPES) else [ASSET]
        files = {
            f"{kind}/{name}": file
            for kind in kinds
            for name, file in read_manifest(folder.parent / kind, f"{kind} {id}").items()
        }
        return SnapshotIndex.of(id, {**files, OVERLAY: StoredFile.of(overlay)}), overlay

    def _is_intact(self, id: str) -> bool:
        """Whether a built asset can be read, with its settings."""
        try:
            self.asset(id)
            self.overlay(id)
        except StoreFormatError:
            raise
        except (StorageError, NotFoundError):
            return False
        return True

    def _settings(self, folder: Path, id: str) -> AssetSettings:
        facts = read_file(folder, f"{ASSET} {id}", FACTS)
        return decode_settings(facts, folder / FACTS)
