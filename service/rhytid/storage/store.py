"""The asset store.

::

    store/
    ├── lock                       held while a server uses the store
    ├── format.json                the marker: that this is a store, and of which format
    ├── cache/                     compiled kernels, where `serve` has no other place for them
    ├── packages/<id>/             skin packages of an asset, one zip each; they go with its
    │                              settings, shapes or itself, or for the room of others
    ├── partial/                   changes being prepared or thrown away; removed on opening
    └── assets/<id>/
        ├── request/               what a caller sent, until the asset is built: a sealed folder
        ├── asset/                 the built asset, never changed: a sealed folder
        ├── shapes/                named shapes of its mesh, if any came: a sealed folder
        ├── overlay.json           the present settings, replaced as a whole
        └── shared.json            in which state a shared store was given it, if one was
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.errors import NotFoundError, StorageError
from rhytid.storage.asset_snapshots import AssetSnapshots
from rhytid.storage.folders import PACKAGES, StoreFolders
from rhytid.storage.homes import (
    ASSET,
    OVERLAY,
    REQUEST,
    SHAPES,
    holds_something,
    is_built,
    is_readable,
    is_requested,
)
from rhytid.storage.manifest import (
    StoredFile,
    read_file,
    read_manifest,
    read_verified,
)
from rhytid.storage.packages import PackageCache
from rhytid.storage.records import (
    MESH,
    StoredAsset,
    StoredRequest,
    changed_settings,
    decode_mesh,
    read_shapes,
    shape_files,
    write_overlay,
)


class AssetStore:
    """Assets in a folder, for one process at a time; safe to call from several threads.

    Each change happens at one rename: after a crash the store holds the state before it or the
    state after it. Opening takes the lock and removes what interrupted changes left behind; what
    rhytid did not make is left alone. Folders are of mode 0700, files of mode 0600. Raises
    StorageError where something that is not of a store is in its way, and StoreFormatError where a
    newer release made it; nothing in it is changed then.

    lock: False: another process, which started this one, holds the lock; several may then use the
    store, each with assets of its own.  packages: bytes of the skin packages that are kept; None:
    any.  Of an instance: the packages, and snapshots, the assets as snapshots.

    Every method raises StorageError where the disk fails or a file is not what was written, and
    NotFoundError for an id that is not stored.
    """

    def __init__(self, folder: Path, *, lock: bool = True, packages: int | None = None) -> None:
        self._folders = StoreFolders(folder, lock=lock)
        self.packages = PackageCache(folder / PACKAGES, self._folders.partial, packages)
        self.snapshots = AssetSnapshots(self._folders, self.delete)
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
        """Ids of the built assets, ascending. An asset that is damaged, or whose folder cannot be
        read, is listed, and raises when it is read."""
        return [
            home.name for home in self._folders.homes() if not is_readable(home) or is_built(home)
        ]

    def pending(self) -> list[str]:
        """Ids of the assets that were requested and are not built yet, ascending."""
        waiting = (
            home for home in self._folders.homes() if is_readable(home) and is_requested(home)
        )
        return [home.name for home in waiting if not is_built(home)]

    def put_request(self, id: str, request: StoredRequest) -> None:
        """Store what a caller sent until the asset is built. Nothing is changed where the store has
        that id."""
        home = self._folders.home(id)
        if not holds_something(home):
            self._folders.seal(home, REQUEST, request.files())

    def request(self, id: str) -> StoredRequest:
        """The content that a caller sent for an asset that is not built yet."""
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
        residual: Residual | None = None,
    ) -> None:
        """Store a built asset with an overlay of its settings, and remove its request.

        settings: resolved.  extra: a JSON object. Raises StorageError where the asset is stored
        already: it does not change, only `delete` removes it.
        """
        home = self._folders.home(id)
        asset = StoredAsset(mesh, graph, settings, dict(extra), stiffness, residual)
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
        """Keep the named shapes of an asset that is built or requested; they replace earlier ones.

        Nothing is written where the store has the same shapes.
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
        """Digests of the files of the named shapes of an asset, by name; empty where it has
        none."""
        try:
            files = read_manifest(self._folders.existing(id, SHAPES), f"{SHAPES} {id}")
        except NotFoundError:
            return {}
        return {name: file.sha256 for name, file in files.items()}

    def contents(self, id: str) -> dict[str, StoredFile]:
        """Sizes and digests of the files of a built asset, as they were written; only the manifest
        is read."""
        return read_manifest(self._folders.existing(id, ASSET), f"{ASSET} {id}")

    def put_overlay(self, id: str, settings: AssetSettings) -> None:
        """Replace the present settings of a built asset."""
        path = self._folders.existing(id, ASSET).parent / OVERLAY
        self._folders.replace(path, write_overlay(f"asset {id}", settings))
        self.packages.forget(id)

    def overlay(self, id: str) -> AssetSettings | None:
        """The present settings of a built asset; None where an older version built it and it never
        changed."""
        return changed_settings(self._folders.existing(id, ASSET).parent)

    def delete(self, id: str) -> None:
        """Remove an asset, its request and its present settings, all at once."""
        self._folders.remove(id)
        self.packages.forget(id)
