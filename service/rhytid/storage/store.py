"""The asset store.

::

    store/
    ├── lock                       held while a server uses the store
    ├── partial/                   changes being prepared or thrown away; emptied on opening
    └── assets/<id>/
        ├── request/               what a caller sent, until the asset is built: a sealed folder
        ├── asset/                 the built asset, never changed: a sealed folder
        └── overlay.json           the present settings, replaced as a whole
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rhytid import durable
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.controls import Controls
from rhytid.domain.folds import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.durable import is_folder, reported
from rhytid.errors import NotFoundError, StorageError
from rhytid.storage.canonical import damaged
from rhytid.storage.homes import (
    ASSET,
    ID,
    REQUEST,
    holds_something,
    homes,
    is_built,
    is_readable,
    is_requested,
    sweep,
)
from rhytid.storage.lock import FolderLock
from rhytid.storage.manifest import (
    StoredFile,
    read_file,
    read_manifest,
    read_verified,
    write_with_manifest,
)
from rhytid.storage.records import (
    FACTS,
    MESH,
    StoredAsset,
    StoredRequest,
    decode_mesh,
    must_have_overlay,
    read_overlay,
    write_overlay,
)

_OVERLAY = "overlay.json"
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class AssetStore:
    """Assets in a folder, for one process at a time; safe to call from several threads.

    Each change happens at one rename: after a crash the store holds the state before it or the
    state after it. Opening takes the lock and removes what interrupted changes left behind.

    Every method raises StorageError where the disk fails or a file is not what was written, and
    NotFoundError for an id that is not stored.
    """

    def __init__(self, folder: Path) -> None:
        self._assets = folder / "assets"
        self._partial = folder / "partial"
        self._changing = threading.Lock()
        with reported(f"store {folder} cannot be opened"):
            self._assets.mkdir(parents=True, exist_ok=True)
            self._partial.mkdir(exist_ok=True)
            self._lock = FolderLock(folder)
            try:
                sweep(self._assets, self._partial)
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Release the lock of the store."""
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
        if not self._put(home, ASSET, asset.files(), {_OVERLAY: overlay}):
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

    def contents(self, id: str) -> dict[str, StoredFile]:
        """Sizes and digests of the files of a built asset, as they were written; only the manifest
        is read."""
        return read_manifest(self._existing(id, ASSET), f"{ASSET} {id}")

    def put_overlay(self, id: str, settings: AssetSettings) -> None:
        """Replace the present settings of a built asset."""
        path = self._existing(id, ASSET).parent / _OVERLAY
        with (
            reported(f"{path} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            durable.write_file(place / _OVERLAY, write_overlay(f"asset {id}", settings))
            durable.install(place / _OVERLAY, path)

    def overlay(self, id: str) -> AssetSettings | None:
        """The present settings, or None of an asset of an older version that never changed."""
        folder = self._existing(id, ASSET)
        path = folder.parent / _OVERLAY
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
            with self._changing:
                if is_folder(home / kind):
                    return False
                home.mkdir(exist_ok=True)
                durable.sync_folder(self._assets)
                for name in before:
                    durable.install(place / name, home / name)
                durable.install(place / kind, home / kind)
        return True

    def _home(self, id: str) -> Path:
        if not ID.fullmatch(id):
            raise NotFoundError(f"no asset {id!r}: ids are 16 hexadecimal digits")
        return self._assets / id

    def _existing(self, id: str, kind: str) -> Path:
        folder = self._home(id) / kind
        if not is_folder(folder):
            raise NotFoundError(f"no {kind} {id} in the store")
        return folder
