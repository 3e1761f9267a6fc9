"""The asset store.

::

    store/
    ├── lock                       held while a server uses the store
    ├── format.json                of which version of rhytid the store is
    ├── cache/                     compiled kernels, where `serve` has no other place for them
    ├── packages/<id>/             skin packages of an asset, thrown away with any change of it
    ├── partial/                   changes being prepared or thrown away; emptied on opening
    └── assets/<id>/
        ├── request/               what a caller sent, until the asset is built: a sealed folder
        ├── asset/                 the built asset, never changed: a sealed folder
        ├── shapes/                named shapes of its mesh, if any came: a sealed folder
        └── overlay.json           the present settings, replaced as a whole
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rhytid import durable
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.controls import Controls
from rhytid.domain.expressions import Expressions
from rhytid.domain.folds import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.durable import is_folder, reported
from rhytid.errors import NotFoundError, StorageError, StoreFormatError
from rhytid.storage.canonical import canonical, check_format, damaged
from rhytid.storage.homes import (
    ASSET,
    ID,
    REQUEST,
    SHAPES,
    holds_something,
    homes,
    is_built,
    is_readable,
    is_requested,
    sweep,
)
from rhytid.storage.kept_shapes import read_shapes, shape_files
from rhytid.storage.lock import FolderLock
from rhytid.storage.manifest import (
    StoredFile,
    read_file,
    read_manifest,
    read_verified,
    write_with_manifest,
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

# Of the store as a whole: raise it when an older version must not open a new store.
FORMAT = 1
_FORMAT = "format.json"
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class AssetStore:
    """Assets in a folder, for one process at a time; safe to call from several threads.

    Each change happens at one rename: after a crash the store holds the state before it or the
    state after it. Opening takes the lock and removes what interrupted changes left behind.

    shared: another process, which started this one, holds the lock; several may then use the store,
    each with assets of its own.  packages: bytes of the skin packages that are kept; None: any.

    Every method raises StorageError where the disk fails or a file is not what was written, and
    NotFoundError for an id that is not stored.
    """

    def __init__(self, folder: Path, *, shared: bool = False, packages: int | None = None) -> None:
        self._assets = folder / "assets"
        self._partial = folder / "partial"
        self.packages = KeptPackages(folder / "packages", self._partial, packages)
        self._changing = threading.Lock()
        with reported(f"store {folder} cannot be opened"):
            self._assets.mkdir(parents=True, exist_ok=True)
            self._partial.mkdir(exist_ok=True)
            self._lock = None if shared else FolderLock(folder)
            if shared:
                return
            try:
                _check_format(folder / _FORMAT, self._partial)
                sweep(self._assets, self._partial)
                self.packages.sweep([home.name for home in homes(self._assets)])
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Release the lock of the store."""
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> AssetStore:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def ids(self) -> list[str]:
        """Ids of the built assets, ascending; one that is damaged, or whose folder cannot be read,
        is listed and raises when read."""
        return [
            home.name for home in homes(self._assets) if not is_readable(home) or is_built(home)
        ]

    def pending(self) -> list[str]:
        """Ids that were requested and are not built yet, ascending."""
        waiting = (home for home in homes(self._assets) if is_readable(home) and is_requested(home))
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
        home = self._home(id)
        if not holds_something(home):
            request = StoredRequest(mesh, settings, graph, stiffness, controls, folds)
            self._put(home, REQUEST, request.files())

    def request(self, id: str) -> StoredRequest:
        """What a caller sent for an asset that is not built yet."""
        folder = self._existing(id, REQUEST)
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
        home = self._home(id)
        asset = StoredAsset(mesh, graph, settings, dict(extra), stiffness)
        overlay = write_overlay(f"asset {id}", settings)
        if not self._put(home, ASSET, asset.files(), {OVERLAY: overlay}):
            raise StorageError(f"asset {id} is stored already, and stored assets do not change")
        with self._changing, reported(f"the request of asset {id} cannot be removed"):
            if is_requested(home):
                durable.discard(home / REQUEST, self._partial)

    def asset(self, id: str) -> StoredAsset:
        """A built asset, every byte of it verified."""
        folder = self._existing(id, ASSET)
        return StoredAsset.read(read_verified(folder, f"{ASSET} {id}"), folder)

    def mesh(self, id: str) -> Mesh:
        """The mesh of an asset, built or not; nothing else of it is read."""
        kind = ASSET if is_built(self._home(id)) else REQUEST
        folder = self._existing(id, kind)
        return decode_mesh(read_file(folder, f"{kind} {id}", MESH), folder / MESH)

    def put_shapes(self, id: str, shapes: Expressions) -> None:
        """Keep the named shapes of an asset that is built or requested, in place of others.

        Where they are there as they are, nothing is written.
        """
        home, files = self._home(id), shape_files(shapes)
        if not holds_something(home):
            raise NotFoundError(f"no asset {id} in the store")
        with suppress(StorageError, NotFoundError):
            if read_verified(self._existing(id, SHAPES), f"{SHAPES} {id}") == files:
                return
        with self._changing, reported(f"the shapes of asset {id} cannot be replaced"):
            if is_folder(home / SHAPES):
                durable.discard(home / SHAPES, self._partial)
        self._put(home, SHAPES, files)
        self.packages.forget(id)

    def shapes(self, id: str) -> Expressions:
        """The named shapes of an asset; raises NotFoundError where it has none."""
        folder = self._existing(id, SHAPES)
        return read_shapes(read_verified(folder, f"{SHAPES} {id}"), folder)

    def shapes_nbytes(self, id: str) -> int:
        """Bytes of the named shapes of an asset; only the manifest is read. Raises NotFoundError
        where it has none."""
        files = read_manifest(self._existing(id, SHAPES), f"{SHAPES} {id}")
        return sum(file.nbytes for file in files.values())

    def shapes_digests(self, id: str) -> dict[str, str]:
        """Digests of the files of its named shapes, by name; none where it has none."""
        try:
            files = read_manifest(self._existing(id, SHAPES), f"{SHAPES} {id}")
        except NotFoundError:
            return {}
        return {name: file.sha256 for name, file in files.items()}

    def contents(self, id: str) -> dict[str, StoredFile]:
        """Sizes and digests of the files of a built asset, as they were written; only the manifest
        is read."""
        return read_manifest(self._existing(id, ASSET), f"{ASSET} {id}")

    def snapshot(self, id: str) -> Snapshot:
        """A built asset with its present settings and its named shapes as one file, every byte of
        it verified; close it."""
        folder = self._existing(id, ASSET)
        overlay = write_overlay(f"{ASSET} {id}", self.overlay(id) or self._settings(folder, id))
        with self._changing:  # shapes are replaced in two steps
            sealed = [ASSET, SHAPES] if is_folder(folder.parent / SHAPES) else [ASSET]
            files = {
                f"{kind}/{name}": file
                for kind in sealed
                for name, file in read_manifest(folder.parent / kind, f"{kind} {id}").items()
            }
            index = SnapshotIndex.of(id, {**files, OVERLAY: StoredFile.of(overlay)})
            made = Snapshot(index, {name: folder.parent / name for name in files}, overlay)
        try:
            made.check()
        except BaseException:
            made.close()
            raise
        return made

    @contextmanager
    def unpacked(self, stream: Readable, nbytes: int) -> Iterator[UnpackedAsset]:
        """The asset of a snapshot of so many bytes, checked in full and stored nowhere yet; see
        `install`. Raises SnapshotError naming what is wrong with it, and where."""
        with (
            reported("a snapshot cannot be unpacked"),
            durable.workplace(self._partial) as place,
        ):
            index = unpack(stream, nbytes, place)
            yield UnpackedAsset.read(index.asset, place)

    def install(self, unpacked: UnpackedAsset) -> bool:
        """Store the asset of a snapshot; False, and nothing is changed, where it is there intact.

        One that is damaged is replaced, a request for it is removed. Raises StoreFormatError where
        another version of rhytid stored it.
        """
        if self._is_intact(unpacked.id):
            return False
        home = self._home(unpacked.id)
        with reported(f"{ASSET} {unpacked.id} cannot be written"):
            if holds_something(home):
                self.delete(unpacked.id)
            before = [OVERLAY, SHAPES] if unpacked.has_shapes else [OVERLAY]
            return self._install(unpacked.place, home, ASSET, before)

    def put_overlay(self, id: str, settings: AssetSettings) -> None:
        """Replace the present settings of a built asset."""
        path = self._existing(id, ASSET).parent / OVERLAY
        with (
            reported(f"{path} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            durable.write_file(place / OVERLAY, write_overlay(f"asset {id}", settings))
            if is_folder(path):  # nothing of ours, and in the way
                durable.discard(path, self._partial)
            durable.install(place / OVERLAY, path)
        self.packages.forget(id)

    def overlay(self, id: str) -> AssetSettings | None:
        """The present settings, or None of an asset of an older version that never changed."""
        folder = self._existing(id, ASSET)
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
        home = self._home(id)
        with self._changing, reported(f"asset {id} cannot be removed"):
            if not holds_something(home):
                raise NotFoundError(f"no asset {id} in the store")
            self.packages.forget(id)
            durable.discard(home, self._partial)

    def _put(
        self,
        home: Path,
        kind: str,
        files: Mapping[str, bytes],
        before: Mapping[str, bytes] = _NOTHING,
    ) -> bool:
        """Seal `files` as home/kind; False, and nothing done, where that is there already.

        before: files that stand in `home` as soon as home/kind does.
        """
        with (
            reported(f"{kind} {home.name} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            write_with_manifest(place / kind, f"{kind} {home.name}", files)
            for name, data in before.items():
                durable.write_file(place / name, data)
            return self._install(place, home, kind, before)

    def _install(self, place: Path, home: Path, kind: str, before: Iterable[str]) -> bool:
        """Make place/kind visible as home/kind, after the files `before`; False, and nothing done,
        where that is there already."""
        with self._changing:
            if is_folder(home / kind):
                return False
            try:
                home.mkdir(exist_ok=True)
                durable.sync_folder(self._assets)
                for name in before:
                    durable.install(place / name, home / name)
                durable.install(place / kind, home / kind)
            except OSError:
                self._abandon(home)
                raise
        return True

    def _abandon(self, home: Path) -> None:
        """Remove a home that a change which failed left without an asset."""
        with suppress(OSError, StorageError):
            if not holds_something(home):
                durable.discard(home, self._partial)

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

    def _home(self, id: str) -> Path:
        if not ID.fullmatch(id):
            raise NotFoundError(f"no asset {id!r}: ids are 16 hexadecimal digits")
        return self._assets / id

    def _existing(self, id: str, kind: str) -> Path:
        folder = self._home(id) / kind
        if not is_folder(folder):
            raise NotFoundError(f"no {kind} {id} in the store")
        return folder


def _check_format(path: Path, partial: Path) -> None:
    """Raise StoreFormatError for a store of a newer version. One of a version that wrote no format
    is of format 1, and is marked so."""
    with suppress(FileNotFoundError):
        try:
            check_format(json.loads(path.read_bytes()), FORMAT, path)
        except (ValueError, RecursionError) as exc:
            raise damaged(path, f"not JSON ({exc})") from exc
        return
    with durable.workplace(partial) as place:
        durable.write_file(place / _FORMAT, canonical({"format": FORMAT}))
        durable.install(place / _FORMAT, path)
