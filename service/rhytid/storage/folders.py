"""The folders of a store, and the changes of them that happen at one rename."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType

from rhytid import durable
from rhytid.durable import is_folder, reported
from rhytid.errors import NotFoundError, StorageError
from rhytid.storage.canonical import canonical, check_format, damaged
from rhytid.storage.homes import checked_id, holds_something, homes, sweep
from rhytid.storage.lock import FolderLock
from rhytid.storage.manifest import write_with_manifest

# Of the store as a whole: raise it when an older version must not open a new store.
FORMAT = 1
_FORMAT = "format.json"
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class StoreFolders:
    """A folder per asset, its home, with sealed folders in it; and a place to prepare changes in.

    Opening takes the lock and removes what interrupted changes left behind.  lock: False: another
    process holds the lock and has done both.  Methods raise StorageError where the disk fails.
    """

    def __init__(self, folder: Path, *, lock: bool) -> None:
        self.assets = folder / "assets"
        self.partial = folder / "partial"
        self._changing = threading.Lock()
        with reported(f"store {folder} cannot be opened"):
            self.assets.mkdir(parents=True, exist_ok=True)
            self.partial.mkdir(exist_ok=True)
            self._lock = FolderLock(folder) if lock else None
            if not lock:
                return
            try:
                _check_format(folder / _FORMAT, self.partial)
                sweep(self.assets, self.partial)
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """Release the lock of the store."""
        if self._lock is not None:
            self._lock.release()

    def homes(self) -> Iterator[Path]:
        """The homes of all assets, by id."""
        return homes(self.assets)

    def home(self, id: str) -> Path:
        """The folder of an asset, there or not; raises NotFoundError for what is no id."""
        return self.assets / checked_id(id)

    def existing(self, id: str, kind: str) -> Path:
        """A sealed folder of an asset; raises NotFoundError where there is none."""
        folder = self.home(id) / kind
        if not is_folder(folder):
            raise NotFoundError(f"no {kind} {id} in the store")
        return folder

    @contextmanager
    def unchanged(self) -> Iterator[None]:
        """Nothing is sealed or removed in the block."""
        with self._changing:
            yield

    @contextmanager
    def workplace(self) -> Iterator[Path]:
        """A fresh folder to prepare a change in, removed afterwards."""
        with durable.workplace(self.partial) as place:
            yield place

    def seal(
        self,
        home: Path,
        kind: str,
        files: Mapping[str, bytes],
        before: Mapping[str, bytes] = _NOTHING,
    ) -> bool:
        """Write `files` with a manifest as home/kind; False, and nothing done, where that is there
        already.

        before: files that stand in `home` as soon as home/kind does.
        """
        with reported(f"{kind} {home.name} cannot be written"), self.workplace() as place:
            write_with_manifest(place / kind, f"{kind} {home.name}", files)
            for name, data in before.items():
                durable.write_file(place / name, data)
            return self.install(place, home, kind, before)

    def install(self, place: Path, home: Path, kind: str, before: Iterable[str]) -> bool:
        """Make place/kind visible as home/kind, after the files `before`; False, and nothing done,
        where that is there already."""
        with self._changing:
            if is_folder(home / kind):
                return False
            try:
                home.mkdir(exist_ok=True)
                durable.sync_folder(self.assets)
                for name in before:
                    durable.install(place / name, home / name)
                durable.install(place / kind, home / kind)
            except OSError:
                self._abandon(home)
                raise
        return True

    def replace(self, path: Path, data: bytes) -> None:
        """Write a file in place of the one that is there."""
        with reported(f"{path} cannot be written"), self.workplace() as place:
            durable.write_file(place / path.name, data)
            if is_folder(path):  # nothing of ours, and in the way
                durable.discard(path, self.partial)
            durable.install(place / path.name, path)

    def discard(self, folder: Path, failing: str) -> None:
        """Remove a folder at one rename, if it is there.  failing: the message of an error."""
        with self._changing, reported(failing):
            if is_folder(folder):
                durable.discard(folder, self.partial)

    def remove(self, id: str) -> None:
        """Remove the home of an asset at one rename; raises NotFoundError where it is empty."""
        home = self.home(id)
        with self._changing, reported(f"asset {id} cannot be removed"):
            if not holds_something(home):
                raise NotFoundError(f"no asset {id} in the store")
            aside = durable.set_aside(home, self.partial)
        # Others need not wait until gigabytes are removed.
        durable.remove_tree(aside)

    def _abandon(self, home: Path) -> None:
        """Remove a home that a change which failed left without an asset."""
        with suppress(OSError, StorageError):
            if not holds_something(home):
                durable.discard(home, self.partial)


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
