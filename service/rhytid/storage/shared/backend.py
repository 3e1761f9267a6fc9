"""Where a shared store keeps its objects: a folder, or a bucket of an object store."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rhytid.errors import (
    RhytidError,
    SharedDamageError,
    SharedStoreError,
    StorageError,
)
from rhytid.support.atomic_files import storage_error_class
from rhytid.support.ownership import FolderKind

MANIFESTS, OBJECTS, PARTIAL = "manifests", "objects", "partial"
# Raise its format when an older release must not use a new shared store.
SHARED_STORE = FolderKind("rhytid shared store", format=1, folders=(MANIFESTS, OBJECTS, PARTIAL))
# What the objects of an asset are called: by their SHA-256.
OBJECT = re.compile(r"[0-9a-f]{64}", re.ASCII)


@dataclass(frozen=True)
class Found:
    """An object of a backend.

    revision: another once the object was written anew.  modified: when it was, in seconds of
    `time.time`.
    """

    revision: str
    nbytes: int
    modified: float


class Backend(Protocol):
    """Named bytes that several machines reach.

    A name is a path with slashes. An object is there whole or not at all, and replaces an earlier
    one of its name. Methods raise SharedStoreError naming the object where the place cannot
    be used, SharedDamageError where it is no plain file, and DiskFullError where a disk is full.
    """

    # Seconds for which what was seen of an object is taken for what is there: 0 where a look costs
    # little.
    fresh: float

    def check(self) -> None:
        """Raise SharedStoreError where nothing can be read here."""

    def claim(self) -> None:
        """Mark the place as a shared store, where that is allowed and was not done before; raises
        StoreFormatError, and changes nothing, where a newer release made the shared store."""

    def find(self, name: str) -> Found | None:
        """An object, of which nothing is read; None where there is none."""

    def read(self, name: str, most: int) -> bytes | None:
        """A small object; None where there is none. Raises SharedDamageError where it has more
        than `most` bytes."""

    def fetch(self, name: str, to: Path) -> bool:
        """Copy an object to the new file `to`; False where there is none."""

    def write(self, name: str, data: bytes) -> None:
        """Write a small object."""

    def local(self, name: str) -> Path | None:
        """The file of an object, where the backend has files that this machine can read."""

    def send(self, name: str, source: Path) -> None:
        """Write an object with the bytes of a file."""

    def put(self, name: str, pieces: Iterable[bytes | memoryview]) -> None:
        """Write an object of any size, which comes in pieces."""

    def create(self, name: str, data: bytes) -> bool:
        """Write a small object at the top where there is none of that name; whether it was. Others
        may see it before all of it is written."""

    def names(self, folder: str) -> list[str]:
        """Names of the objects that lie in a folder, without it, ascending."""

    def found(self, folder: str) -> dict[str, Found]:
        """The objects that lie in a folder, by the names of `names`."""

    def remove(self, name: str) -> bool:
        """Remove an object, if it is there; whether it was."""


def damaged(place: object, name: str, why: str) -> SharedDamageError:
    """The error for an object that is not what was written."""
    return SharedDamageError(f"{place}/{name} is damaged: {why}")


def too_large(place: object, name: str, size: int, most: int) -> SharedDamageError:
    """The error for an object that is not read, since it has more bytes than it may."""
    return damaged(place, name, f"it has {size} bytes: at most {most}")


@contextmanager
def reached(doing: str) -> Iterator[None]:
    """The border where what libraries raise becomes SharedStoreError, or DiskFullError."""
    try:
        yield
    except RhytidError:
        raise
    except OSError as exc:
        kind = storage_error_class(exc)
        raise (SharedStoreError if kind is StorageError else kind)(f"{doing}: {exc}") from exc
    except Exception as exc:  # clients of object stores have many kinds of their own
        raise SharedStoreError(f"{doing}: {type(exc).__name__}: {exc}") from exc
