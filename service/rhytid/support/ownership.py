"""Folders that are ours: what may be removed in them, and who may read what we make.

A folder is ours where it holds our marker: a small file that says what the folder is, and in which
format. An entry of such a folder is ours where it has a name that we make and is no link. Anything
else is left alone.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from rhytid.errors import StorageError, StoreFormatError

MARKER = "format.json"
# What files and folders are called that are being written, or thrown away.
UNIQUE = re.compile(r"[0-9a-f]{32}", re.ASCII)
# What others than the owner may do: nothing, or the group as much as the owner.
_GROUP, _OTHERS = 0o070, 0o007
# Bytes of a marker, at most.
_LONGEST = 1 << 16
# Names in a message.
_NAMED = 3
# A file system that knows no modes, and a file that is somebody else's.
_NO_MODES = (errno.EPERM, errno.EACCES, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EROFS)
_log = logging.getLogger(__name__)


class NotPlainError(OSError):
    """A link, a folder, a device or a pipe where a plain file should be."""

    def __init__(self, path: Path) -> None:
        super().__init__(errno.EINVAL, "it is no plain file", str(path))


@dataclass(frozen=True)
class FolderKind:
    """A kind of folder that we make, by its marker.

    name: of the kind, in the marker.  format: the newest that this release reads, and the one that
    it writes.  folders: folders in it from which we remove files.  needed: those of `folders` that
    every earlier release made together with the marker.  marker: the name of the marker's file.
    unnamed: the marker of an earlier release holds a format and no name.
    """

    name: str
    format: int = 1
    folders: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    marker: str = MARKER
    unnamed: bool = False

    def text(self) -> bytes:
        """The bytes of the marker."""
        return json.dumps({"format": self.format, "kind": self.name}).encode()

    def reads(self, data: bytes, folder: object) -> bool:
        """Whether a marker with these bytes is as this release writes it; False for one of an
        earlier release.

        Raises StoreFormatError where a newer release wrote the marker, StorageError where it is
        damaged or names another kind.  folder: named in the message.
        """
        path = f"{folder}/{self.marker}"
        try:
            found = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise StorageError(f"{path} is damaged: not JSON ({error})") from error
        named = found.get("format") if isinstance(found, dict) else None
        earlier = self.unnamed and found == {"format": named}
        kind = found.get("kind", self.name if earlier else None) if named else None
        if type(named) is not int or kind != self.name:
            what = f"it does not say that this is a {self.name}"
            raise StorageError(f"{path} is not ours: {what}. {_CHOOSE}")
        if named > self.format:
            raise StoreFormatError(
                f"{folder} was made by a newer release of rhytid (format {named}, this one reads "
                f"up to {self.format}): nothing in it was changed. Use that release, or choose "
                "another folder"
            )
        return named == self.format and "kind" in found


_CHOOSE = "Nothing was changed there: choose another folder"


def check_owned(
    folder: Path, kind: FolderKind, before: Callable[[Path], bool] | None = None
) -> bool:
    """Whether a folder has its marker in the form that this release writes.

    before: tells whether a folder without a marker is of a release that wrote none. Raises
    StorageError naming what is in the way and not ours, StoreFormatError where a newer release made
    the folder, and OSError. Nothing is changed; `atomic_files.claim` writes the marker.
    """
    # Seen before the marker is read: another process that makes these folders now marks them first.
    filled = [folder / name for name in kind.folders if _is_filled(folder / name)]
    data = None
    with suppress(FileNotFoundError, NotADirectoryError):
        data = read_plain(folder / kind.marker, _LONGEST)
    current = data is not None and kind.reads(data, folder)
    # A marker without a name could be of others; with one came these folders.
    earlier = data is not None and all(is_real_folder(folder / name) for name in kind.needed)
    known = current or earlier or (before is not None and before(folder))
    for path in filled:
        if path.is_symlink() or not known:
            raise not_owned(path)
    return current


def is_marked(folder: Path, kind: FolderKind) -> bool:
    """Whether a folder, which is no link, has a marker of ours that this release reads."""
    try:
        data = read_plain(folder / kind.marker, _LONGEST) if is_real_folder(folder) else None
        if data is not None:
            kind.reads(data, folder)
    except (OSError, StorageError):
        return False
    return data is not None


def not_owned(path: Path) -> StorageError:
    """The error for an entry of others where one of ours should be."""
    return StorageError(f"{path} is not ours: rhytid did not make it. {_CHOOSE}")


def is_real_folder(path: Path) -> bool:
    """Whether a path is a folder, and no link to one. Raises OSError where the system does not
    tell."""
    with suppress(FileNotFoundError, NotADirectoryError):
        return stat.S_ISDIR(path.lstat().st_mode)
    return False


def _is_filled(path: Path) -> bool:
    """Whether there is something of that name but an empty folder."""
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    return not stat.S_ISDIR(mode) or any(path.iterdir())


def owned_entries(folder: Path, name: re.Pattern[str]) -> Iterator[Path]:
    """The files and folders in `folder` whose names match and that are no links, by name; the log
    names the other entries."""
    strangers = []
    for entry in sorted(folder.iterdir()):
        if name.fullmatch(entry.name) and is_plain(entry):
            yield entry
        else:
            strangers.append(entry.name)
    if strangers:
        more = f" and {len(strangers) - _NAMED} more" if len(strangers) > _NAMED else ""
        named = ", ".join(strangers[:_NAMED])
        _log.warning("left alone in %s, not made by rhytid: %s%s", folder, named, more)


def is_plain(path: Path) -> bool:
    """Whether a path is a file or a folder, and no link, device or pipe; False where it is gone."""
    with suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        return stat.S_ISDIR(mode) or stat.S_ISREG(mode)
    return False


def open_plain(path: Path) -> BinaryIO:
    """Open a plain file to read it. Raises NotPlainError for anything else, without waiting for a
    pipe or a device."""
    if not stat.S_ISREG(path.lstat().st_mode):  # to open a device may do something
        raise NotPlainError(path)
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        file = open(os.open(path, flags | getattr(os, "O_BINARY", 0)), "rb")  # noqa: SIM115
    except OSError as error:
        if error.errno == errno.ELOOP:  # a link by now
            raise NotPlainError(path) from error
        raise
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise NotPlainError(path)
    return file


def read_plain(path: Path, most: int) -> bytes:
    """The bytes of a plain file; raises NotPlainError for anything else, and OSError with EFBIG
    where it has more than `most`."""
    with open_plain(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"it has more than {most} bytes", str(path))
    return data


def has_group(folder: Path) -> bool:
    """Whether the group of a folder may write into it and owns what is made there. Such a group
    gets the rights of the owner."""
    found = folder.stat()
    if os.name == "nt" or not found.st_mode & stat.S_IWGRP:
        return False
    return bool(found.st_mode & stat.S_ISGID) or found.st_gid == os.getegid()


def is_open_to_others(path: Path) -> bool:
    """Whether anybody but its owner has a right to a file or a folder."""
    return bool(stat.S_IMODE(path.lstat().st_mode) & (_GROUP | _OTHERS))


def restrict(path: Path, *, group: bool = False) -> None:
    """Take the rights to a file, or to a folder and all in it, from everybody but its owner.

    group: its group gets the rights of the owner. Files of another user, and of file systems
    without modes, stay as they are.
    """
    restrict_folder(path, group=group)
    if is_real_folder(path):
        for place, folders, files in os.walk(path):
            for name in (*folders, *files):
                restrict_folder(Path(place, name), group=group)


def restrict_folder(path: Path, *, group: bool = False) -> None:
    """As `restrict`, of a file or a folder without what is in it: users who may not pass through a
    folder cannot reach its files."""
    mode = path.lstat().st_mode
    if stat.S_ISLNK(mode):
        return
    before = stat.S_IMODE(mode)
    owner = before & stat.S_IRWXU
    given = owner >> 3 if group else 0
    after = (before & ~(_GROUP | _OTHERS)) | given
    if after == before:
        return
    try:
        path.chmod(after)
    except OSError as error:
        if error.errno not in _NO_MODES:
            raise


def make_folder(path: Path, *, group: bool = False) -> None:
    """Make a folder for its owner alone, or its group, too, unless it exists."""
    with suppress(FileExistsError):
        path.mkdir(mode=0o700)
        restrict_folder(path, group=group)
