"""A folder that several machines mount, as the backend of a shared store."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

from typing_extensions import override

from rhytid.errors import InputError, SharedStoreError, StorageError, StoreFormatError
from rhytid.storage.homes import ID
from rhytid.storage.shared.backend import (
    MANIFESTS,
    OBJECT,
    OBJECTS,
    PARTIAL,
    SHARED_STORE,
    Backend,
    Found,
    damaged,
    reached,
    too_large,
)
from rhytid.support import atomic_files, cancellation
from rhytid.support.atomic_files import copy_file, sync_file, sync_folder, write_file, write_pieces
from rhytid.support.ownership import (
    NotPlainError,
    check_owned,
    has_group,
    is_real_folder,
    make_folder,
    open_plain,
    restrict,
    restrict_folder,
)

T = TypeVar("T")
# How often a file is put into a folder that `remove` takes meanwhile.
_TRIES = 10
# Bytes that are in memory at a time.
_PIECE = 1 << 20
_MANIFEST = re.compile(ID.pattern + r"\.json", re.ASCII)


class FolderBackend(Backend):
    """Objects as files below a folder, written aside in its `partial` and renamed.

    Files and folders are for their owner alone; where the group of the folder may write into it,
    for that group, too. Raises InputError where the folder is not there, since it may have to be
    mounted, or where something in it is in the way that is not ours; StoreFormatError where a newer
    release made the shared store. Nothing is changed there then.
    """

    fresh = 0.0

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"shared store {folder}: no such folder; make it, or mount it")
        self._folder, self._partial = folder.resolve(), folder.resolve() / PARTIAL
        self._claimed = False
        with suppress(OSError), _refused(self):  # a mount that fails now may be back later
            check_owned(self._folder, SHARED_STORE, holds_assets)

    def __str__(self) -> str:
        return str(self._folder)

    def check(self) -> None:
        """As `Backend.check`; removes what writers that ended long ago left behind."""
        with reached(f"shared store {self} cannot be read"):
            self.claim()
            group = has_group(self._folder)
            make_folder(self._partial, group=group)
            for name in SHARED_STORE.folders:  # earlier releases let everybody in
                with suppress(FileNotFoundError):
                    restrict_folder(self._folder / name, group=group)
            atomic_files.sweep_partial(self._partial, at_once=False)

    def claim(self) -> None:
        """As `Backend.claim`; raises InputError where something in the way is not ours."""
        with reached(f"shared store {self} cannot be read"), _refused(self):
            if self._claimed and is_real_folder(self._partial):
                return
            self._claimed = check_owned(self._folder, SHARED_STORE, holds_assets)
            if not self._claimed:
                with suppress(OSError):  # it may only be read, or is full: then it is marked later
                    atomic_files.claim(self._folder, SHARED_STORE, holds_assets)
                    self._claimed = True

    @override
    def find(self, name: str) -> Found | None:
        return self._looked(name, _plain)

    @override
    def read(self, name: str, most: int) -> bytes | None:
        return self._looked(name, lambda path: self._bounded(name, path, most))

    @override
    def fetch(self, name: str, to: Path) -> bool:
        if self._looked(name, lambda path: _copy_plain(path, to)) is None:
            return False
        with reached(f"{to} cannot be written"):
            sync_file(to)
        return True

    @override
    def write(self, name: str, data: bytes) -> None:
        self._install(name, lambda aside: write_file(aside, data))

    @override
    def local(self, name: str) -> Path | None:
        return self._folder / name

    @override
    def send(self, name: str, source: Path) -> None:
        self._install(name, partial(copy_file, source))

    @override
    def put(self, name: str, pieces: Iterable[bytes | memoryview]) -> None:
        self._install(name, lambda aside: write_pieces(aside, pieces))

    @override
    def create(self, name: str, data: bytes) -> bool:
        path = self._folder / name
        with reached(f"{path} cannot be written"):
            self.claim()
            group = has_group(self._folder)
            try:
                made = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            except FileExistsError:
                return False
            try:
                with open(made, "wb") as file:
                    file.write(data)
            except BaseException:  # such as of a full disk: another caller makes it
                path.unlink(missing_ok=True)
                raise
            restrict(path, group=group)
        return True

    @override
    def names(self, folder: str) -> list[str]:
        found = self._looked(folder, lambda path: sorted(file.name for file in path.iterdir()))
        return found or []

    @override
    def found(self, folder: str) -> dict[str, Found]:
        return self._looked(folder, _plain_files) or {}

    def remove(self, name: str) -> bool:
        """As `Backend.remove`, and its folder, where that is empty then."""
        path, known = self._folder / name, False
        with reached(f"{path} cannot be removed"):
            with suppress(FileNotFoundError):
                path.unlink()
                known = True
            if path.parent != self._folder:
                with suppress(OSError):  # others are in it, or it is gone
                    path.parent.rmdir()
        return known

    def _bounded(self, name: str, path: Path, most: int) -> bytes:
        with open_plain(path) as file:
            data = file.read(most + 1)
            if len(data) > most:
                raise too_large(self, name, os.fstat(file.fileno()).st_size, most)
        return data

    def _looked(self, name: str, look: Callable[[Path], T]) -> T | None:
        path = self._folder / name
        with reached(f"{path} cannot be read"), suppress(FileNotFoundError):
            try:
                return look(path)
            except NotPlainError as error:
                raise damaged(self, name, "it is no plain file") from error
        if not self._folder.is_dir():
            raise SharedStoreError(f"shared store {self} is gone: is it mounted?")
        return None

    def _install(self, name: str, write: Callable[[Path], None]) -> None:
        path = self._folder / name
        with reached(f"{path} cannot be written"):
            self.claim()
            group = has_group(self._folder)
            make_folder(self._partial, group=group)
            with atomic_files.working_folder(self._partial, group=group) as place:
                aside = place / path.name
                write(aside)
                restrict(aside, group=group)
                self._move(aside, path, group)
            sync_folder(self._folder if path.parent == self._folder else path.parent.parent)

    def _move(self, aside: Path, path: Path, group: bool) -> None:
        """Make a file visible in its folder, which is made again where `remove` takes it meanwhile.
        Raises FileNotFoundError where it takes the file, too, or the folder again and again."""
        for _ in range(_TRIES):
            with suppress(FileNotFoundError):
                for around in reversed(path.relative_to(self._folder).parents[:-1]):
                    make_folder(self._folder / around, group=group)
                return atomic_files.install(aside, path)
            if not aside.exists():
                break
        raise FileNotFoundError(f"{path.parent} is being removed")


@contextmanager
def _refused(place: FolderBackend) -> Iterator[None]:
    """The border where StorageError becomes InputError: the user has named the folder."""
    try:
        yield
    except StoreFormatError:
        raise
    except StorageError as error:
        raise InputError(f"shared store {place}: {error}") from error


def holds_assets(folder: Path) -> bool:
    """Whether a folder without a marker is a shared store of a release that wrote none."""
    manifests, objects = folder / MANIFESTS, folder / OBJECTS
    if is_real_folder(manifests):
        for file in manifests.iterdir():
            if _MANIFEST.fullmatch(file.name) and file.is_file():
                return True
    if not is_real_folder(objects):
        return False
    assets = (asset for asset in objects.iterdir() if ID.fullmatch(asset.name))
    return any(
        OBJECT.fullmatch(file.name) and file.is_file()
        for asset in assets
        if is_real_folder(asset)
        for file in asset.iterdir()
    )


def _plain(path: Path) -> Found:
    found = path.lstat()
    if not stat.S_ISREG(found.st_mode):
        raise NotPlainError(path)
    return Found(f"{found.st_mtime_ns}-{found.st_ino}", found.st_size, found.st_mtime)


def _plain_files(folder: Path) -> dict[str, Found]:
    files = {}
    for path in sorted(folder.iterdir()):
        with suppress(FileNotFoundError, NotPlainError):  # removed meanwhile, or not ours
            files[path.name] = _plain(path)
    return files


def _copy_plain(path: Path, to: Path) -> bool:
    """Copy the bytes that a plain file has now, and no more, to a new file."""
    with open_plain(path) as source, to.open("xb") as target:
        left = os.fstat(source.fileno()).st_size
        while left and (piece := source.read(min(left, _PIECE))):
            cancellation.check()
            target.write(piece)
            left -= len(piece)
    return True
