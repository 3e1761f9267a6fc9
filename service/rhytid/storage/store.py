"""The asset store.

::

    store/
    ├── lock                       held while a server uses the store
    ├── partial/                   changes being prepared or thrown away; emptied on opening
    └── assets/<id>/
        ├── request/               what a caller sent, until the asset is built: a sealed folder
        ├── asset/                 the built asset, never changed: a sealed folder
        └── overlay.json           settings changed since, replaced as a whole
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.controls import Controls
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.errors import NotFoundError, StorageError
from rhytid.storage import durable
from rhytid.storage.durable import reported
from rhytid.storage.lock import FolderLock
from rhytid.storage.records import StoredAsset, StoredRequest, read_overlay, write_overlay
from rhytid.storage.sealed import seal, unseal

_ID = re.compile(r"[0-9a-f]{16}", re.ASCII)
_REQUEST, _ASSET, _OVERLAY = "request", "asset", "overlay.json"


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
                self._sweep()
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Let another process have the store."""
        self._lock.release()

    def __enter__(self) -> AssetStore:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def ids(self) -> list[str]:
        """Ids of the built assets, ascending; a damaged one is listed and raises when read."""
        return [home.name for home in self._homes() if (home / _ASSET).is_dir()]

    def pending(self) -> list[str]:
        """Ids that were requested and are not built yet, ascending."""
        waiting = (home for home in self._homes() if (home / _REQUEST).is_dir())
        return [home.name for home in waiting if not (home / _ASSET).is_dir()]

    def put_request(
        self,
        id: str,
        mesh: Mesh,
        settings: AssetSettings,
        graph: WrinkleGraph | None,
        stiffness: Stiffness | None = None,
        controls: Controls | None = None,
    ) -> None:
        """Keep what a caller sent until the asset is built; a known id is left as it is."""
        home = self._home(id)
        if not (home / _ASSET).is_dir() and not (home / _REQUEST).is_dir():
            request = StoredRequest(mesh, settings, graph, stiffness, controls)
            self._put(home, _REQUEST, request.files())

    def request(self, id: str) -> StoredRequest:
        """What a caller sent for an asset that is not built yet."""
        folder = self._existing(id, _REQUEST)
        return StoredRequest.read(unseal(folder, f"{_REQUEST} {id}"), folder)

    def put_asset(
        self,
        id: str,
        mesh: Mesh,
        graph: WrinkleGraph,
        settings: AssetSettings,
        extra: Mapping[str, Any],
        stiffness: Stiffness | None = None,
    ) -> None:
        """Keep a built asset, for good, and drop its request.

        `settings` are resolved; `extra` is a JSON object. Raises StorageError where the asset is
        there already: it does not change, only `delete` removes it.
        """
        home = self._home(id)
        asset = StoredAsset(mesh, graph, settings, dict(extra), stiffness)
        if not self._put(home, _ASSET, asset.files()):
            raise StorageError(f"asset {id} is stored already, and stored assets do not change")
        with self._changing, reported(f"the request of asset {id} cannot be removed"):
            if (home / _REQUEST).is_dir():
                durable.discard(home / _REQUEST, self._partial)

    def asset(self, id: str) -> StoredAsset:
        """A built asset, every byte of it verified."""
        folder = self._existing(id, _ASSET)
        return StoredAsset.read(unseal(folder, f"{_ASSET} {id}"), folder)

    def put_overlay(self, id: str, settings: AssetSettings) -> None:
        """Replace the settings that were changed since the asset was built."""
        path = self._existing(id, _ASSET).parent / _OVERLAY
        with (
            reported(f"{path} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            durable.write_file(place / _OVERLAY, write_overlay(f"asset {id}", settings))
            durable.install(place / _OVERLAY, path)

    def overlay(self, id: str) -> AssetSettings | None:
        """The settings of the last `put_overlay`, or None."""
        path = self._existing(id, _ASSET).parent / _OVERLAY
        with reported(f"{path} cannot be read"):
            data = path.read_bytes() if path.exists() else None
        return None if data is None else read_overlay(f"asset {id}", data, path)

    def delete(self, id: str) -> None:
        """Remove an asset, its request and its changed settings, all at once."""
        home = self._home(id)
        with self._changing, reported(f"asset {id} cannot be removed"):
            if not _holds_something(home):
                raise NotFoundError(f"no asset {id} in the store")
            durable.discard(home, self._partial)

    def _put(self, home: Path, kind: str, files: Mapping[str, bytes]) -> bool:
        """Seal `files` as home/kind; False, and nothing done, where that is there already."""
        with (
            reported(f"{kind} {home.name} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            seal(place / kind, f"{kind} {home.name}", files)
            with self._changing:
                if (home / kind).is_dir():
                    return False
                home.mkdir(exist_ok=True)
                durable.sync_folder(self._assets)
                durable.install(place / kind, home / kind)
        return True

    def _home(self, id: str) -> Path:
        if not _ID.fullmatch(id):
            raise NotFoundError(f"no asset {id!r}: ids are 16 hexadecimal digits")
        return self._assets / id

    def _existing(self, id: str, kind: str) -> Path:
        folder = self._home(id) / kind
        if not folder.is_dir():
            raise NotFoundError(f"no {kind} {id} in the store")
        return folder

    def _homes(self) -> Iterator[Path]:
        with reported(f"{self._assets} cannot be read"):
            entries = sorted(self._assets.iterdir())
        return (entry for entry in entries if _ID.fullmatch(entry.name))

    def _sweep(self) -> None:
        for leftover in self._partial.iterdir():
            durable.remove_tree(leftover)
        for home in self._homes():
            if not _holds_something(home):
                durable.discard(home, self._partial)
            elif (home / _ASSET).is_dir() and (home / _REQUEST).is_dir():
                durable.discard(home / _REQUEST, self._partial)


def _holds_something(home: Path) -> bool:
    return (home / _ASSET).is_dir() or (home / _REQUEST).is_dir()
