"""Skin packages on disk: made from assets, kept while there is room, and made again.

A package is one file, a zip whose files are stored as they are, one after the other. A file of the
package is a part of that archive: one open file is enough for all of them, and it stays whole when
the archive is removed meanwhile.
"""

from __future__ import annotations

import logging
import os
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from rhytid.errors import LimitError, StorageError
from rhytid.storage.canonical import damaged
from rhytid.storage.homes import ID
from rhytid.support import atomic_files, cancellation
from rhytid.support.atomic_files import is_folder, storage_errors
from rhytid.support.ownership import UNIQUE, is_real_folder, make_folder, owned_entries, restrict

_log = logging.getLogger(__name__)
LIMIT = "RHYTID_PACKAGES_MB"
_SUFFIX, _FILES, _ARCHIVE = ".zip", "files", "package.zip"
# The archives that we make, by their names.
_NAME = re.compile(UNIQUE.pattern + re.escape(_SUFFIX), re.ASCII)
# Files of up to so many bytes are compared with their checksums when an archive is read.
CHECKED = 1 << 18
# The local header of a file: its bytes, and the place of the lengths of name and further fields.
_HEADER, _LENGTHS = 30, struct.Struct("<26xHH")


@dataclass(frozen=True)
class CachedPackage:
    """A package in the cache.

    file: the archive.  files: the range of bytes of each file in it.  inode: of the archive.
    """

    file: Path
    nbytes: int
    files: dict[str, range]
    inode: int


class PackageCache:
    """Skin packages as archives `folder`/ASSET/NAME.zip, each whole as soon as it is visible.

    limit: bytes of all of them; the least recently used are removed first. None: no limit. Every
    method raises StorageError where the disk fails, DiskFullError where it is full. Safe from any
    thread, and beside other processes that use the same folder.
    """

    def __init__(self, folder: Path, partial: Path, limit: int | None) -> None:
        self._folder, self._partial, self._limit = folder, partial, limit
        # Archives that were opened before, by their files.
        self._read: dict[Path, CachedPackage] = {}

    def find(self, asset: str, name: str) -> CachedPackage | None:
        """The package of an asset; None where the cache lacks it, or it is damaged."""
        file = self._at(asset, name)
        with storage_errors(f"{file} cannot be read"):
            try:
                facts = file.stat()
                known = self._read.get(file)
                if known is None or (known.inode, known.nbytes) != (facts.st_ino, facts.st_size):
                    self._read.pop(file, None)
                    known = self._read[file] = _opened(file)
            except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
                self._read.pop(file, None)
                return None
            except StorageError as error:
                _log.warning("a package is made anew: %s", error)
                return None
        with suppress(OSError):  # it was removed, or the disk is read-only
            os.utime(file)
        return known

    @contextmanager
    def making(self, asset: str) -> Iterator[Path]:
        """A folder to write a package into; it is removed afterwards with everything in it."""
        with (
            storage_errors(f"the package of asset {asset} cannot be written"),
            atomic_files.working_folder(self._partial) as place,
        ):
            made = place / _FILES
            made.mkdir()
            yield made

    def seal(self, made: Path, between: Callable[[], None] = lambda: None) -> None:
        """Make an archive of the files in `made`, and make room for it in the cache.

        between: called before each file. Raises LimitError where the archive is larger than the
        limit.
        """
        archive = made.with_name(_ARCHIVE)
        write_archive(made, archive, between)
        self.make_room(archive.stat().st_size)

    def keep(self, asset: str, name: str, made: Path) -> None:
        """Move the archive of `made` to its place in the cache, where it replaces an earlier
        one."""
        file = self._at(asset, name)
        with storage_errors(f"the package of asset {asset} cannot be kept"):
            make_folder(self._folder)
            make_folder(file.parent)
            if is_folder(file):  # nothing of ours, and in the way
                self._remove(file)
            restrict(made.with_name(_ARCHIVE))
            atomic_files.install(made.with_name(_ARCHIVE), file)

    def make_room(self, nbytes: int) -> None:
        """Remove the least recently used packages until so many bytes fit."""
        if self._limit is None:
            return
        if nbytes > self._limit:
            raise LimitError(
                f"the package has {nbytes} bytes: all that are kept may have {self._limit}, "
                f"by {LIMIT}"
            )
        kept = sorted(self._kept())
        left = sum(size for _, size, _ in kept)
        for _, size, at in kept:
            if left + nbytes <= self._limit:
                return
            if self._remove(at):
                left -= size

    def forget(self, asset: str) -> None:
        """Remove the packages of an asset that was changed or removed. One that cannot be removed
        stays: packages of the changed asset have other names."""
        home = self._folder / asset
        for at in _entries(home, _NAME):
            self._remove(at)
        with suppress(OSError):  # it is not there, or something else is in it
            if is_real_folder(home):
                home.rmdir()

    def sweep(self, assets: list[str]) -> None:
        """Remove the packages of all assets but these.

        A package that cannot be removed or read is left as it is, for the store works without it.
        So is everything that is no package.
        """
        for home in _entries(self._folder, ID):
            if home.name not in assets:
                self.forget(home.name)

    def _at(self, asset: str, name: str) -> Path:
        return self._folder / asset / f"{name}{_SUFFIX}"

    def _kept(self) -> Iterator[tuple[float, int, Path]]:
        """When each was asked for, its bytes, its place."""
        for home in _entries(self._folder, ID):
            for at in _entries(home, _NAME):
                with suppress(OSError):  # others remove some meanwhile
                    facts = at.stat()
                    yield facts.st_mtime, facts.st_size, at

    def _remove(self, at: Path) -> bool:
        """Whether it is gone."""
        for file in [file for file in self._read.copy() if file == at or at in file.parents]:
            self._read.pop(file, None)
        try:
            atomic_files.discard(at, self._partial)
        except (FileNotFoundError, NotADirectoryError):
            return True
        except OSError as error:
            _log.warning("%s is left as it is: %s", at, error)
            return False
        return True


def _opened(file: Path) -> CachedPackage:
    with file.open("rb") as archive:
        facts = os.fstat(archive.fileno())
        return CachedPackage(file, facts.st_size, read_archive(archive, file), facts.st_ino)


def _entries(folder: Path, name: re.Pattern[str]) -> list[Path]:
    """The entries of a folder that rhytid made, ascending; none where it cannot be read."""
    try:
        return list(owned_entries(folder, name)) if is_real_folder(folder) else []
    except FileNotFoundError:
        return []
    except OSError as error:
        _log.warning("%s is left as it is: %s", folder, error)
        return []


def write_archive(folder: Path, archive: Path, between: Callable[[], None]) -> None:
    """Move the files of `folder` into the new file `archive`, which is on the disk when this
    returns.

    The same files give the same bytes.  between: called before each file.
    """
    with archive.open("xb") as out:
        with ZipFile(out, "w", ZIP_STORED) as zipped:
            for name, file in files(folder):
                between()
                about = ZipInfo(name)
                about.file_size, about.external_attr = file.stat().st_size, 0o644 << 16
                with file.open("rb") as source, zipped.open(about, "w") as member:
                    for piece in cancellation.check_each(iter(partial(source.read, 1 << 20), b"")):
                        member.write(piece)
                file.unlink()  # so that a package takes its room on the disk once
        out.flush()
        os.fsync(out.fileno())


def read_archive(archive: BinaryIO, path: Path) -> dict[str, range]:
    """The range of bytes of each file of an archive, by the path of the file in the package.

    Raises StorageError where the archive is not as it was written: cut short, or with other sizes;
    the bytes of small files are checked, too.
    """
    try:
        with ZipFile(archive) as zipped:
            found: dict[str, range] = {}
            end = 0
            for about in zipped.infolist():
                if about.header_offset != end:
                    raise BadZipFile(f"{about.filename} is not where it was written")
                with zipped.open(about) as member:  # raises where its header says other things
                    if about.file_size <= CHECKED:
                        member.read()  # raises where its checksum is another
                start = _start(archive, end)
                end = start + about.file_size
                found[about.filename] = range(start, end)
            if zipped.start_dir != end:
                raise BadZipFile("its files end elsewhere")
    except (BadZipFile, struct.error, EOFError, RuntimeError, ValueError) as error:
        raise damaged(path, str(error)) from error
    return found


def files(folder: Path) -> list[tuple[str, Path]]:
    """The files of a folder, by path in it, ascending."""
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    return [(file.relative_to(folder).as_posix(), file) for file in found]


def _start(archive: BinaryIO, header: int) -> int:
    """Where the bytes of a file begin, whose local header is there."""
    archive.seek(header)
    name, further = _LENGTHS.unpack(archive.read(_HEADER))
    return header + _HEADER + int(name) + int(further)
