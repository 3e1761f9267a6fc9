"""A folder that several machines mount, as the place of a shared store."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

from rhytid import durable
from rhytid.durable import copy_file, sync_folder, write_file
from rhytid.errors import InputError, SharedStoreError
from rhytid.storage.shared.place import reached

T = TypeVar("T")
# How often a file is put into a folder that `remove` takes meanwhile.
_TRIES = 10


class FolderPlace:
    """Objects as files below a folder, written aside in its `partial` and renamed.

    Raises InputError where the folder is not there: it may have to be mounted.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"shared store {folder}: no such folder; make it, or mount it")
        self._folder, self._partial = folder.resolve(), folder.resolve() / "partial"

    def __str__(self) -> str:
        return str(self._folder)

    def check(self) -> None:
        """As `Place.check`; removes what writers that ended long ago left behind."""
        with reached(f"shared store {self} cannot be read"):
            self._partial.mkdir(exist_ok=True)
            durable.sweep(self._partial, begins="")

    def size(self, name: str) -> int | None:
        """As `Place.size`."""
        return self._found(name, lambda path: path.stat().st_size)

    def read(self, name: str) -> bytes | None:
        """As `Place.read`."""
        return self._found(name, Path.read_bytes)

    def fetch(self, name: str, to: Path) -> bool:
        """As `Place.fetch`."""

        def copied(path: Path) -> bool:
            copy_file(path, to)
            return True

        return self._found(name, copied) is not None

    def write(self, name: str, data: bytes) -> None:
        """As `Place.write`."""
        self._install(name, lambda aside: write_file(aside, data))

    def send(self, name: str, source: Path) -> None:
        """As `Place.send`."""
        self._install(name, partial(copy_file, source))

    def names(self, folder: str) -> list[str]:
        """As `Place.names`."""
        found = self._found(folder, lambda path: sorted(file.name for file in path.iterdir()))
        return found or []

    def remove(self, name: str) -> None:
        """As `Place.remove`, and its folder, where that is empty then."""
        path = self._folder / name
        with reached(f"{path} cannot be removed"):
            path.unlink(missing_ok=True)
            with suppress(OSError):  # others are in it, or it is gone
                path.parent.rmdir()

    def _found(self, name: str, look: Callable[[Path], T]) -> T | None:
        path = self._folder / name
        with reached(f"{path} cannot be read"), suppress(FileNotFoundError):
            return look(path)
        if not self._folder.is_dir():
            raise SharedStoreError(f"shared store {self} is gone: is it mounted?")
        return None

    def _install(self, name: str, write: Callable[[Path], None]) -> None:
        path = self._folder / name
        with reached(f"{path} cannot be written"):
            self._partial.mkdir(exist_ok=True)
            with durable.workplace(self._partial) as place:
                aside = place / path.name
                write(aside)
                _move(aside, path)
            sync_folder(path.parent.parent)


def _move(aside: Path, path: Path) -> None:
    """Make a file visible in a folder that `remove` may take, empty, or with the file in it: then
    this raises FileNotFoundError, and so it does where it fails again and again."""
    for _ in range(_TRIES):
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            return durable.install(aside, path)
        if not aside.exists():
            break
    raise FileNotFoundError(f"{path.parent} is being removed")
