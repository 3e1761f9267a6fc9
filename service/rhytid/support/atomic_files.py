"""File operations that a crash never leaves half done: synced, then made visible by one rename."""

from __future__ import annotations

import errno
import hashlib
import logging
import os
import re
import shutil
import stat
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path

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
    read_plain,
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


def _new_name() -> str:
    """A name that nobody has, as UNIQUE. To import uuid takes longer than many a command."""
    return os.urandom(16).hex()


# Folders in which `atomic_write` prepares the files of other folders: see `prepared_in`.
_places: dict[Path, Path] = {}
# Files that `atomic_write` prepares now, by where.
_prepared: dict[Path, Path] = {}
# SHA-256 of those that `write_hashed` has written.
_digests: dict[Path, str] = {}
# See `before_naming`.
_before: ContextVar[Callable[[str], object] | None] = ContextVar("before naming", default=None)
# How often a folder is emptied in which others write, and the seconds between two times.
_TRIES, _PAUSE = 10, 0.02
# Bytes that are copied at a time.
_PIECE = 1 << 22
# The mode of a file that others may read.
READABLE = 0o644
_KINDS = {**dict.fromkeys(_FULL, DiskFullError), **dict.fromkeys(_OPEN, TooManyFilesError)}


@contextmanager
def storage_errors(doing: str) -> Iterator[None]:
    """In the block, an OSError becomes a StorageError: a DiskFullError where the disk is full, a
    TooManyFilesError where too many files are open.  doing: begins the message."""
    try:
        yield
    except OSError as exc:
        named = exc.filename2 is None and doing.startswith(f"{exc.filename} ")
        raise storage_error_class(exc)(f"{doing}: {exc.strerror if named else exc}") from exc


def storage_error_class(failure: OSError) -> type[StorageError]:
    """The class of the error that callers get for an OSError: StorageError or one of its kinds."""
    return _KINDS.get(failure.errno, StorageError) if failure.errno else StorageError


def is_folder(path: Path) -> bool:
    """Whether a path is a folder. Raises StorageError where the system does not tell;
    `Path.is_dir` may answer no there."""
    with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError, NotADirectoryError):
        return stat.S_ISDIR(path.stat().st_mode)
    return False


def write_file(path: Path, data: bytes) -> None:
    """Write a new file. Its bytes are on the disk when this returns; raises FileExistsError where
    the file is there."""
    write_pieces(path, [data])


def write_pieces(path: Path, pieces: Iterable[bytes | memoryview]) -> None:
    """Write a new file that comes in pieces, as `write_file` does."""
    with path.open("xb") as file:
        file.writelines(pieces)
        file.flush()
        os.fsync(file.fileno())


def write_hashed(path: Path, pieces: Iterable[bytes | memoryview]) -> str:
    """Write a new file as `write_pieces` does; SHA-256 of its bytes, taken on a thread of its own
    while they are written, so that none is read again."""
    digest, every = hashlib.sha256(), list(pieces)
    hashing = threading.Thread(target=_update, args=(digest, every))
    hashing.start()
    try:
        write_pieces(path, every)
    finally:
        hashing.join()
    if path in _prepared:
        _digests[path] = digest.hexdigest()
    return digest.hexdigest()


def _update(digest: hashlib._Hash, pieces: list[bytes | memoryview]) -> None:
    for piece in pieces:
        digest.update(piece)


def copy_file(source: Path, to: Path) -> None:
    """Copy the bytes of a file to another, new or not. They are on the disk when this returns.

    Raises the error of `cancellation.check` where the work of this thread is cancelled.
    """
    with source.open("rb") as read, to.open("wb") as write:
        write.writelines(cancellation.check_each(iter(partial(read.read, _PIECE), b"")))
        write.flush()
        os.fsync(write.fileno())


def sync_file(path: Path) -> None:
    """Put the bytes of a file that other code has written on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Put the names in a folder on the disk. Windows offers no way and needs none."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def install(source: Path, target: Path) -> None:
    """Make `source` visible as `target`, by one rename: the step at which a change happens.

    A file replaces a file of that name; a folder needs a name that is free.
    """
    source.replace(target)
    sync_folder(target.parent)


def claim(folder: Path, kind: FolderKind, before: Callable[[Path], bool] | None = None) -> None:
    """Write the marker of a folder that has none as this release writes it: then it is ours.

    before: see `check_owned`. Raises what `check_owned` raises, and then changes nothing.
    """
    if check_owned(folder, kind, before):
        return
    aside = folder / f".{kind.marker}-{_new_name()}"
    try:
        write_file(aside, kind.text())
        restrict(aside, group=has_group(folder))
        install(aside, folder / kind.marker)
    finally:
        aside.unlink(missing_ok=True)


@contextmanager
def working_folder(partial: Path, *, group: bool = False) -> Iterator[Path]:
    """A fresh folder in `partial` in which a change is prepared, removed when the block ends.

    group: its group has the rights of its owner.
    """
    place = partial / _new_name()
    place.mkdir(mode=0o700)
    with _removed_after(place):
        if group:
            restrict(place, group=True)
        yield place


@contextmanager
def _removed_after(place: Path) -> Iterator[Path]:
    """Remove a folder, which was just made, when the block ends."""
    with removed_on_abort(place):
        try:
            yield place
        finally:
            remove_tree(place)


@contextmanager
def _hidden_working_folder(folder: Path) -> Iterator[Path]:
    """A fresh folder in one that holds files of others, with a name and a marker by which `sweep`
    knows it; in the folder that `prepared_in` says, if it can be made there."""
    with _removed_after(_new_hidden_folder(folder)) as place:
        yield place


def _new_hidden_folder(folder: Path) -> Path:
    name = f"{_UNFINISHED}{_new_name()}"
    if (other := _places.get(folder)) is not None:
        with suppress(OSError):  # it is gone, or of another user
            return _marked_folder(other / name)
    return _marked_folder(folder / name)


def _marked_folder(place: Path) -> Path:
    """Make a folder with a marker, or nothing. The marker is not synced: each map of a bake has
    such a folder for a moment."""
    place.mkdir(mode=0o700)
    try:
        with open(place / UNFINISHED.marker, "xb", opener=_readable, buffering=0) as marker:
            if marker.write(UNFINISHED.text()) != len(UNFINISHED.text()):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except BaseException:
        remove_tree(place)
        raise
    return place


def _readable(path: str, flags: int) -> int:
    return os.open(path, flags, READABLE)


@contextmanager
def shared_working_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in `folder` that other users on other machines may read, removed when the
    block ends.

    A process that is killed in the block leaves the folder: see `sweep`. Work that takes longer
    than a day has to touch the folder now and then. Others may write there until the end.
    """
    with _hidden_working_folder(folder) as place:
        place.chmod(0o755 | place.stat().st_mode & stat.S_ISGID)
        try:
            yield place
        finally:
            with suppress(FileNotFoundError):  # the process ends, and has removed it
                _empty(place)


def _empty(place: Path) -> None:
    """Remove all but the marker from a folder in which others may still begin a file."""
    for _ in range(_TRIES):
        left = [one for one in place.iterdir() if one.name != UNFINISHED.marker]
        if not left:
            return
        for one in left:
            remove_tree(one)
        time.sleep(_PAUSE)


@contextmanager
def prepared_in(place: Path, folder: Path) -> Iterator[None]:
    """While the block runs, `atomic_write` prepares the files of `folder` in `place`, for as long
    as that is there and may be written to.

    place: on the same file system, such as a `shared_working_folder`. Who removes it removes what a
    process that is killed leaves unfinished. Of two blocks at a time for one folder, the last one
    that began counts.
    """
    _places[folder] = place
    try:
        yield
    finally:
        if _places.get(folder) is place:
            del _places[folder]


@contextmanager
def atomic_write(file: Path, *, private: bool = False, group: bool = False) -> Iterator[Path]:
    """A path to write to; what is written there becomes `file` when the block ends without error.

    private: the file is readable for its owner alone, else as the system makes files.  group: with
    `private`, for its group, too. A process that is killed in the block leaves a hidden folder
    beside `file`, or where `prepared_in` says: see `sweep`. A full disk is told as one of `file`.
    """
    with _naming_where_full(file), _hidden_working_folder(file.parent) as place:
        if group:
            restrict(place, group=True)
        aside = place / file.name
        _prepared[aside] = file
        try:
            yield aside
            if private:
                restrict(aside, group=group)
            _tell_whole(aside)
            install(aside, file)
        finally:
            del _prepared[aside]
            _digests.pop(aside, None)


@contextmanager
def _naming_where_full(file: Path) -> Iterator[None]:
    """In the block, an OSError for lack of room names the file that users know: what fails to be
    written names none, or one in a hidden folder."""
    try:
        yield
    except OSError as exc:
        parts = Path(exc.filename or "").parts
        if exc.errno in _FULL and (not parts or any(map(_HIDDEN.fullmatch, parts))):
            exc.filename = str(file)
        raise


@contextmanager
def before_naming(do: Callable[[str], object]) -> Iterator[None]:
    """While the block runs, `atomic_write` of this thread calls `do` with the SHA-256 of each file
    that is whole, before the file gets its name. What `do` writes itself is left out."""
    token = _before.set(do)
    try:
        yield
    finally:
        _before.reset(token)


def _tell_whole(aside: Path) -> None:
    if (do := _before.get()) is None:
        return
    token = _before.set(None)
    try:
        do(_digests.get(aside) or _digest_of(aside))
    finally:
        _before.reset(token)


def _digest_of(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for piece in iter(partial(file.read, _PIECE), b""):
            digest.update(piece)
    return digest.hexdigest()


def being_written() -> list[Path]:
    """The files that `atomic_write` has begun and not finished, in their order. From any thread."""
    return [file for aside, file in _prepared.copy().items() if aside.exists()]


def sweep(folder: Path, finished: Callable[[str], bool] | None = None) -> None:
    """Remove the hidden folders that killed writers left in `folder`, once they are a day old.

    Nothing else in `folder` is touched.  finished: tells by its name whether a file is complete; a
    hidden folder that holds such files alone is removed at once. Raises OSError where `folder`
    cannot be read.
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
    """Remove what killed writers left in the `partial` of a folder of ours, once it is a day old.

    at_once: no writer is at work, so remove all of it now. Entries whose names we do not make are
    left alone, and named in the log.
    """
    for left in owned_entries(partial, UNIQUE):
        with suppress(FileNotFoundError):
            if at_once or _is_abandoned(left):
                remove_tree(left)


def _remove_empty(left: Path) -> None:
    """Remove a folder whose writer was killed, or had no room, before it had marked it."""
    marker = left / UNFINISHED.marker
    with suppress(OSError):  # something is in it
        if [*left.iterdir()] == [marker] and stat.S_ISREG(marker.lstat().st_mode):
            longest = len(UNFINISHED.text())
            if not UNFINISHED.text().startswith(read_plain(marker, longest)):
                return
            marker.unlink()
        left.rmdir()


def _is_abandoned(left: Path) -> bool:
    return left.lstat().st_mtime < time.time() - _ABANDONED


def _holds_only(folder: Path, finished: Callable[[str], bool]) -> bool:
    names = {file.name for file in folder.iterdir()} - {UNFINISHED.marker}
    return bool(names) and all(map(finished, names))


def discard(path: Path, partial: Path) -> None:
    """Remove a file or a folder: one rename into `partial` hides it, then its space is freed."""
    remove_tree(set_aside(path, partial))


def set_aside(path: Path, partial: Path) -> Path:
    """Hide a file or a folder by one rename into `partial`; returns where it is then, for
    `remove_tree`."""
    aside = partial / _new_name()
    path.replace(aside)
    with suppress(FileNotFoundError):  # another change took the folder around it
        sync_folder(path.parent)
    return aside


def remove_tree(path: Path) -> None:
    """Free the space of a folder or a file that is hidden; of a link, remove the link alone.

    Where that fails, the log says so, and `sweep_partial` tries again when the store opens next.
    """
    try:
        if is_real_folder(path):
            shutil.rmtree(path)
        else:
            path.unlink()
    except OSError as exc:
        _log.warning("cannot remove %s now: %s", path, exc)
