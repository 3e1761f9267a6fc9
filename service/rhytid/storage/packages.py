"""Skin packages on disk: made from assets, kept while there is room, and made again."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rhytid import durable
from rhytid.durable import is_folder, reported
from rhytid.errors import LimitError, StorageError

LIMIT = "RHYTID_PACKAGES_MB"
_log = logging.getLogger(__name__)


class KeptPackages:
    """Folders `folder`/ASSET/NAME, whole as soon as they are there.

    limit: bytes of all of them; those that were asked for longest ago go first. None: no bound.
    Every method raises StorageError where the disk fails, DiskFullError where it is full.
    """

    def __init__(self, folder: Path, partial: Path, limit: int | None) -> None:
        self._folder, self._partial, self._limit = folder, partial, limit

    def find(self, asset: str, name: str) -> Path | None:
        """The folder of a package; None where it is not kept."""
        found = self._folder / asset / name
        if not is_folder(found):
            return None
        with suppress(OSError):  # it was removed, or the disk is read-only
            os.utime(found)
        return found

    @contextmanager
    def making(self, asset: str) -> Iterator[Path]:
        """A folder to write a package into, removed afterwards unless `keep` has taken it."""
        with (
            reported(f"the package of asset {asset} cannot be written"),
            durable.workplace(self._partial) as place,
        ):
            made = place / "package"
            made.mkdir()
            yield made

    def keep(self, asset: str, name: str, made: Path) -> None:
        """Move a package to its place; raises LimitError where it is larger than all may be."""
        self.make_room(sum(size for _, size in files(made)))
        with reported(f"the package of asset {asset} cannot be kept"):
            (self._folder / asset).mkdir(parents=True, exist_ok=True)
            durable.install(made, self._folder / asset / name)

    def make_room(self, nbytes: int) -> None:
        """Remove what was asked for longest ago until so many bytes fit."""
        if self._limit is None:
            return
        if nbytes > self._limit:
            raise LimitError(
                f"the package has {nbytes} bytes: all that are kept may have {self._limit}, "
                f"by {LIMIT}"
            )
        with reported("packages cannot be counted"):
            kept = sorted((_used(at), _size(at), at) for at in self._kept())
        left = sum(size for _, size, _ in kept)
        for _, size, at in kept:
            if left + nbytes <= self._limit:
                return
            self._remove(at)
            left -= size

    def forget(self, asset: str) -> None:
        """Remove the packages of an asset; what resists is made anew all the same."""
        try:
            if is_folder(self._folder / asset):
                self._remove(self._folder / asset)
        except StorageError as error:
            _log.warning("%s", error)

    def sweep(self, assets: list[str]) -> None:
        """Remove those of assets that there are not."""
        with reported(f"{self._folder} cannot be read"), suppress(FileNotFoundError):
            for at in self._folder.iterdir():
                if at.name not in assets:
                    self._remove(at)

    def _kept(self) -> Iterator[Path]:
        with suppress(FileNotFoundError, NotADirectoryError):
            for home in self._folder.iterdir():
                with suppress(FileNotFoundError, NotADirectoryError):
                    yield from home.iterdir()

    def _remove(self, at: Path) -> None:
        with reported(f"{at} cannot be removed"), suppress(FileNotFoundError):
            durable.discard(at, self._partial)


def files(folder: Path) -> list[tuple[str, int]]:
    """The files of a folder, by path in it, and their bytes."""
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    return [(file.relative_to(folder).as_posix(), file.stat().st_size) for file in found]


def _used(at: Path) -> float:
    with suppress(FileNotFoundError):
        return at.stat().st_mtime
    return 0.0


def _size(at: Path) -> int:
    with suppress(FileNotFoundError):
        return sum(size for _, size in files(at))
    return 0
