"""File operations that are whole after a crash: synced first, then visible by one rename."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from uuid import uuid4

from rhytid import stopping
from rhytid.errors import DiskFullError, StorageError, TooManyFilesError
from rhytid.unfinished import unfinished

_log = logging.getLogger(__name__)
# A full disk; a quota that is used up; a file beyond the largest that the system or a limit allows.
_FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
# As many files are open as this process, or the system, may have.
_OPEN = (errno.EMFILE, errno.ENFILE)
# Begins the names of folders that hold unfinished files; seconds until such a folder is abandoned.
_UNFINISHED, _ABANDONED = ".unfinished-", 24 * 3600.0
# Bytes that are copied at a time.
_PIECE = 1 << 22
# The mode of a file that others may read.
READABLE = 0o644
_KINDS = {**dict.fromkeys(_FULL, DiskFullError), **dict.fromkeys(_OPEN, TooManyFilesError)}


@contextmanager
def reported(doing: str) -> Iterator[None]:
    """The border where an OSError becomes a StorageError: on a full disk a DiskFullError, where
    too many files are open a TooManyFilesError."""
    try:
        yield
    except OSError as exc:
        raise kind_of(exc)(f"{doing}: {exc}") from exc


def kind_of(failure: OSError) -> type[StorageError]:
    """What a failure is to callers: StorageError where it is neither of its kinds."""
    return _KINDS.get(failure.errno, StorageError) if failure.errno else StorageError


def is_folder(path: Path) -> bool:
    """Whether there is a folder of that name; raises StorageError where that cannot be seen, which
    `Path.is_dir` may take for no."""
    with reported(f"{path} cannot be read"), suppress(FileNotFoundError, NotADirectoryError):
        return stat.S_ISDIR(path.stat().st_mode)
    return False


def write_file(path: Path, data: bytes) -> None:
    """A new file at `path` whose bytes are on the disk when this returns."""
    write_pieces(path, [data])


def write_pieces(path: Path, pieces: Iterable[bytes | memoryview]) -> None:
    """As `write_file`, of a file that comes in pieces."""
    with path.open("xb") as file:
        file.writelines(pieces)
        file.flush()
        os.fsync(file.fileno())


def copy_file(source: Path, to: Path) -> None:
    """Write what is in one file to another, whose bytes are on the disk when this returns; stops
    where the work of this thread is to stop."""
    with source.open("rb") as read, to.open("wb") as write:
        write.writelines(stopping.each(iter(partial(read.read, _PIECE), b"")))
        write.flush()
        os.fsync(write.fileno())


def sync_file(path: Path) -> None:
    """Put what another program's code has written into a file on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Put the names in `folder` on the disk; Windows offers no way and needs none."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def install(source: Path, target: Path) -> None:
    """Make `source` visible as `target`: the one step at which a change happens.

    A file replaces the file that is there; a folder needs its place to be free.
    """
    source.replace(target)
    sync_folder(target.parent)


@contextmanager
def workplace(partial: Path, prefix: str = "") -> Iterator[Path]:
    """A fresh folder in `partial` to prepare a change in, removed afterwards; its name begins with
    the prefix."""
    place = partial / f"{prefix}{uuid4().hex}"
    place.mkdir()
    with unfinished(place):
        try:
            yield place
        finally:
            remove_tree(place)


@contextmanager
def shared_workplace(folder: Path) -> Iterator[Path]:
    """A hidden folder in `folder` whose files other users of other machines may read, removed
    afterwards.

    A process that is killed meanwhile leaves it: see `sweep`. What lasts longer than a day touches
    it now and then.
    """
    with workplace(folder, _UNFINISHED) as place:
        place.chmod(0o755)
        yield place


@contextmanager
def whole(file: Path) -> Iterator[Path]:
    """A path to write to, in place of `file`, which is there when the block has ended well.

    A process that is killed meanwhile leaves a hidden folder beside `file`: see `sweep`.
    """
    with workplace(file.parent, _UNFINISHED) as place:
        aside = place / file.name
        yield aside
        install(aside, file)


def sweep(
    folder: Path, ours: Callable[[str], bool] | None = None, *, begins: str = _UNFINISHED
) -> None:
    """Remove what writers of files in `folder` left there that were killed, a day later: nobody is
    at work in it any more.

    ours: whether a file of that name is one that nobody writes any more; a folder that holds
    nothing else is removed at once.  begins: what the names of unfinished files and folders begin
    with; empty where `folder` holds nothing else. Raises OSError where `folder` cannot be read.
    """
    before = time.time() - _ABANDONED
    for left in folder.iterdir():
        if not left.name.startswith(begins):
            continue
        with suppress(FileNotFoundError):  # it was in use, and is done
            known = ours is not None and _holds_only(left, ours)
            if known or left.stat().st_mtime < before:
                remove_tree(left)


def _holds_only(folder: Path, ours: Callable[[str], bool]) -> bool:
    names = [file.name for file in folder.iterdir()]
    return bool(names) and all(map(ours, names))


def discard(path: Path, partial: Path) -> None:
    """Make `path` disappear by one rename into `partial`, then free its space."""
    remove_tree(set_aside(path, partial))


def set_aside(path: Path, partial: Path) -> Path:
    """Make `path` disappear by one rename into `partial`; where it is now, for `remove_tree`."""
    aside = partial / uuid4().hex
    path.replace(aside)
    with suppress(FileNotFoundError):  # another change took the folder around it
        sync_folder(path.parent)
    return aside


def remove_tree(folder: Path) -> None:
    """Free the space of a folder or a file that nobody sees; what resists is swept when the store
    opens next."""
    try:
        if folder.is_file():
            folder.unlink()
        else:
            shutil.rmtree(folder)
    except OSError as exc:
        _log.warning("cannot remove %s now: %s", folder, exc)
