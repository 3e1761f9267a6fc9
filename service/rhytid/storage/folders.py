"""The folders of a store, and the changes of them that happen at one rename."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType

from rhytid.errors import NotFoundError, StorageError
from rhytid.storage.homes import checked_id, holds_homes, holds_something, homes, sweep
from rhytid.storage.lock import LOCK, FolderLock
from rhytid.storage.manifest import Content, write_with_manifest
from rhytid.support import atomic_files
from rhytid.support.atomic_files import is_folder, storage_errors
from rhytid.support.ownership import (
    MARKER,
    FolderKind,
    check_owned,
    is_open_to_others,
    is_real_folder,
    make_folder,
    restrict,
    restrict_folder,
)

ASSETS, PARTIAL, PACKAGES = "assets", "partial", "packages"
_OURS = (ASSETS, PARTIAL, PACKAGES)
# The marker of the whole store: raise its format when an older release must not open a new store.
STORE = FolderKind("rhytid store", folders=_OURS, needed=(ASSETS, PARTIAL), unnamed=True)
# Other entries that a store may have: kernels, a fleet's shared folder, API keys.
_BESIDE = {MARKER, LOCK, "cache", "shared", "keys.json", "keys.json.asked", "keys.json.lock"}
_NOTHING: Mapping[str, bytes] = MappingProxyType({})


class StoreFolders:
    """The folders of a store: one per asset, its home, with sealed folders in it; and a folder to
    prepare changes in.

    Opening takes the lock, marks the store and removes what interrupted changes left behind. It
    raises StorageError where something is in the way that is not of a store, and StoreFormatError
    where a newer release made the store; nothing is changed then.  lock: False: another process
    holds the lock and has done all this.  Methods raise StorageError where the disk fails.
    """

    def __init__(self, folder: Path, *, lock: bool) -> None:
        self.assets, self.partial = folder / ASSETS, folder / PARTIAL
        self._changing = threading.Lock()
        self._lock: FolderLock | None = None
        with storage_errors(f"store {folder} cannot be opened"):
            if not lock:
                self._make()
                return
            check_owned(folder, STORE, _holds_assets)  # before anything is written there
            folder.parent.mkdir(parents=True, exist_ok=True)
            make_folder(folder)
            self._lock = FolderLock(folder)
            try:
                atomic_files.claim(folder, STORE, _holds_assets)
                self._make()
                _hide(folder)
                sweep(self.assets, self.partial)
            except BaseException:
                self.close()
                raise

    def _make(self) -> None:
        make_folder(self.assets)
        make_folder(self.partial)

    def close(self) -> None:
        """Release the lock of the store."""
        if self._lock is not None:
            self._lock.release()

    def homes(self) -> Iterator[Path]:
        """The homes of all assets, by id."""
        return homes(self.assets)

    def home(self, id: str) -> Path:
        """The home of an asset, whether it exists or not; raises NotFoundError where the id is
        malformed."""
        return self.assets / checked_id(id)

    def existing(self, id: str, kind: str) -> Path:
        """A sealed folder of an asset; raises NotFoundError where there is none."""
        folder = self.home(id) / kind
        if not is_folder(folder):
            raise NotFoundError(f"no {kind} {id} in the store")
        return folder

    @contextmanager
    def unchanged(self) -> Iterator[None]:
        """Within the block no other thread seals or removes a folder."""
        with self._changing:
            yield

    @contextmanager
    def workplace(self) -> Iterator[Path]:
        """A fresh folder to prepare a change in, removed afterwards."""
        with atomic_files.working_folder(self.partial) as place:
            yield place

    def seal(
        self,
        home: Path,
        kind: str,
        files: Mapping[str, Content],
        before: Mapping[str, bytes] = _NOTHING,
    ) -> bool:
        """Write `files` with a manifest as home/kind; return False, and do nothing, where home/kind
        exists.

        before: files that stand in `home` as soon as home/kind does.
        """
        failing = f"{kind} {home.name} cannot be written in {self.assets.parent}"
        with storage_errors(failing), self.workplace() as place:
            write_with_manifest(place / kind, f"{kind} {home.name}", files)
            for name, data in before.items():
                atomic_files.write_file(place / name, data)
            return self.install(place, home, kind, before)

    def install(self, place: Path, home: Path, kind: str, before: Iterable[str]) -> bool:
        """Make place/kind visible as home/kind, after the files `before`; return False, and do
        nothing, where home/kind exists."""
        with self._changing:
            if is_folder(home / kind):
                return False
            try:
                make_folder(home)
                atomic_files.sync_folder(self.assets)
                for name in (*before, kind):
                    restrict(place / name)
                    atomic_files.install(place / name, home / name)
            except OSError:
                self._abandon(home)
                raise
        return True

    def replace(self, path: Path, data: bytes) -> None:
        """Write a file, which replaces the one at the path."""
        with storage_errors(f"{path} cannot be written"), self.workplace() as place:
            atomic_files.write_file(place / path.name, data)
            if is_folder(path):  # nothing of ours, and in the way
                atomic_files.discard(path, self.partial)
            restrict(place / path.name)
            atomic_files.install(place / path.name, path)

    def discard(self, folder: Path, failing: str) -> None:
        """Remove a folder at one rename, if it exists.  failing: the message of an error."""
        with self._changing, storage_errors(failing):
            if is_folder(folder):
                atomic_files.discard(folder, self.partial)

    def remove(self, id: str) -> None:
        """Remove the home of an asset at one rename; raises NotFoundError where it is empty."""
        home = self.home(id)
        with self._changing, storage_errors(f"asset {id} cannot be removed"):
            if not holds_something(home):
                raise NotFoundError(f"no asset {id} in the store")
            aside = atomic_files.set_aside(home, self.partial)
        # Others need not wait until gigabytes are removed.
        atomic_files.remove_tree(aside)

    def _abandon(self, home: Path) -> None:
        """Remove a home that a change which failed left without an asset."""
        with suppress(OSError, StorageError):
            if not holds_something(home):
                atomic_files.discard(home, self.partial)


def _holds_assets(folder: Path) -> bool:
    """Whether a folder without a marker is a store of a release that wrote none."""
    return holds_homes(folder / ASSETS)


def _hide(folder: Path) -> None:
    """Leave a store to its owner, as earlier releases did not. What others have put into `folder`
    stays within their reach."""
    for name in (*_OURS, LOCK):
        with suppress(FileNotFoundError):
            if is_open_to_others(folder / name):
                restrict_folder(folder / name)
                if name in (ASSETS, PACKAGES):
                    _hide_homes(folder / name)
    if {entry.name for entry in folder.iterdir()} <= {*_OURS, *_BESIDE}:
        restrict_folder(folder)


def _hide_homes(place: Path) -> None:
    for home in homes(place) if is_real_folder(place) else ():
        restrict(home)
