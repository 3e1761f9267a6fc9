"""File operations that a crash never leaves half done: synced, then made visible by one rename."""

from __future__ import annotations

import errno
import logging
import os
import re
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from uuid import uuid4

from rhytid.errors import DiskFullError, StorageError, TooManyFilesError
from rhytid.support import cancellation
from rhytid.support.ownership import (
    UNIQUE,
    FolderKind,
    check_owned,
    has_group,
    is_marked,
    is_real_folder,
    owned_entries,
    restrict,
)
from rhytid.support.temporary_folders import removed_on_abort

_log = logging.getLogger(__name__)
# A full disk; a quota that is used up; a file beyond the largest that the system or a limit allows.
_FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
# As many files are open as this process, or the system, may have.
_OPEN = (errno.EMFILE, errno.ENFILE)
# Begins the names of folders that hold unfinished files among files of others; each has a marker.
# Seconds until such a folder is abandoned.
_UNFINISHED, _ABANDONED = ".unfinished-", 24 * 3600.0
_HIDDEN = re.compile(re.escape(_UNFINISHED) + UNIQUE.pattern, re.ASCII)
UNFINISHED = FolderKind("rhytid unfinished", marker=".rhytid-unfinished")
# Bytes that are copied at a time.
_PIECE = 1 << 22
# The mode of a file that others may read.
READABLE = 0o644
_KINDS = {**dict.fromkeys(_FULL, DiskFullError), **dict.fromkeys(_OPEN, TooManyFilesError)}


@contextmanager
def storage_errors(doing: str) -> Iterator[None]:
    """The border where an OSError becomes a StorageError: on a full disk a DiskFullError, where
    too many files are open a TooManyFilesError."""
    try:
        yield
    except OSError as exc:
        raise storage_error_class(exc)(f"{doing}: {exc}") from exc


def storage_error_class(failure: OSError) -> type[StorageError]:
    """What a failure is to callers: StorageError where it is neither of its kinds."""
    return _KINDS.get(failure.errno, StorageError) if failure.errno else StorageError


def is_folder(path: Path) -> bool:
    """Whether there is a folder of that name; raises StorageError where that cannot be seen, which
    `Path.is_dir` may take for no."""
    with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError, NotADirectoryError):
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
        write.writelines(cancellation.check_each(iter(partial(read.read, _PIECE), b"")))
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


def claim(folder: Path, kind: FolderKind, before: Callable[[Path], bool] | None = None) -> None:
    """Mark a folder as ours, unless it is marked so; raises what `check_owned` does, and then
    nothing is changed."""
    if check_owned(folder, kind, before):
        return
    aside = folder / f".{kind.marker}-{uuid4().hex}"
    try:
        write_file(aside, kind.text())
        restrict(aside, group=has_group(folder))
        install(aside, folder / kind.marker)
    finally:
        aside.unlink(missing_ok=True)


@contextmanager
def working_folder(partial: Path, *, group: bool = False) -> Iterator[Path]:
    """A fresh folder in `partial` to prepare a change in, removed afterwards.  group: of its group,
    too."""
    with _working_folder(partial / uuid4().hex) as place:
        if group:
            restrict(place, group=True)
        yield place


@contextmanager
def _working_folder(place: Path) -> Iterator[Path]:
    place.mkdir(mode=0o700)
    with removed_on_abort(place):
        try:
            yield place
        finally:
            remove_tree(place)


@contextmanager
def _hidden_working_folder(folder: Path) -> Iterator[Path]:
    """The same in a folder that holds files of others, with a name and a marker by which `sweep`
    knows it."""
    with _working_folder(folder / f"{_UNFINISHED}{uuid4().hex}") as place:
        _mark_unfinished(place)
        yield place


def _mark_unfinished(place: Path) -> None:
    """Write its marker, which need not last; each map of a bake has such a folder for a moment."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    descriptor = os.open(place / UNFINISHED.marker, flags, 0o644)
    try:
        os.write(descriptor, UNFINISHED.text())
    finally:
        os.close(descriptor)


@contextmanager
def shared_working_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in `folder` whose files other users of other machines may read, removed
    afterwards.

    A process that is killed meanwhile leaves it: see `sweep`. What lasts longer than a day touches
    it now and then.
    """
    with _hidden_working_folder(folder) as place:
        place.chmod(0o755)
        yield place


@contextmanager
def atomic_write(file: Path, *, private: bool = False, group: bool = False) -> Iterator[Path]:
    """A path to write to, in place of `file`, which is there when the block has ended well.

    private: for its owner alone, else as the system makes files.  group: and for its group. A
    process that is killed meanwhile leaves a hidden folder beside `file`: see `sweep`.
    """
    with _hidden_working_folder(file.parent) as place:
        if group:
            restrict(place, group=True)
        aside = place / file.name
        yield aside
        if private:
            restrict(aside, group=group)
        install(aside, file)


def sweep(folder: Path, finished: Callable[[str], bool] | None = None) -> None:
    """Remove what writers of files in `folder` left there that were killed, a day later: nobody is
    at work in it any more. All else in it is somebody else's.

    finished: whether a file of that name is one that nobody writes any more; a folder that holds
    nothing else is removed at once. Raises OSError where `folder` cannot be read.
    """
    for left in folder.iterdir():
        if not (_HIDDEN.fullmatch(left.name) and is_real_folder(left)):
            continue
        with suppress(FileNotFoundError):  # it was in use, and is done
            if not is_marked(left, UNFINISHED):
                if _is_abandoned(left):
                    _remove_empty(left)
            elif _is_abandoned(left) or (finished is not None and _holds_only(left, finished)):
                remove_tree(left)


def sweep_partial(partial: Path, *, at_once: bool) -> None:
    """Remove what is left in the `partial` of a folder of ours, by its name.  at_once: nobody works
    there now; otherwise a day later. The log names what else is there; it is left alone."""
    for left in owned_entries(partial, UNIQUE):
        with suppress(FileNotFoundError):
            if at_once or _is_abandoned(left):
                remove_tree(left)


def _remove_empty(left: Path) -> None:
    """Remove a folder whose writer was killed before it had marked it."""
    with suppress(OSError):  # something is in it
        left.rmdir()


def _is_abandoned(left: Path) -> bool:
    return left.lstat().st_mtime < time.time() - _ABANDONED


def _holds_only(folder: Path, finished: Callable[[str], bool]) -> bool:
    names = {file.name for file in folder.iterdir()} - {UNFINISHED.marker}
    return bool(names) and all(map(finished, names))


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


def remove_tree(path: Path) -> None:
    """Free the space of a folder or a file that nobody sees; of a link, which points to what is
    not ours, the link alone. What resists is swept when the store opens next."""
    try:
        if is_real_folder(path):
            shutil.rmtree(path)
        else:
            path.unlink()
    except OSError as exc:
        _log.warning("cannot remove %s now: %s", path, exc)
