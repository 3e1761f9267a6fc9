"""Folders of unfinished work, so that a process that ends at once can remove them.

A process that is killed cannot. So those among the temporary files of the system hold a locked
file, and the next process that makes one removes those whose lock nobody holds. File systems that
machines share may keep locks in one machine, or in one mount: the file is the folder's marker
(`ownership.FolderKind`), too, and says where its lock is seen. Elsewhere a folder is not ours.
"""

from __future__ import annotations

import atexit
import os
import re
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from rhytid.support.ownership import FolderKind, is_marked

if sys.platform != "win32":
    import fcntl

# Of each which folder it is, so that no other is removed that has its name by then.
_folders: dict[Path, tuple[int, int]] = {}
# Another thread, or a process that is ending, may still write into a folder while it is removed:
# how often that is tried, and the seconds between two tries.
_TRIES, _PAUSE = 10, 0.02
# What our folders among the temporary files are called, the file in them that is locked as long as
# their process is there, and the folder beside it, for what is made there.
_OURS = re.compile(r"rhytid-(?:[a-z]+-)?[a-z0-9_]{8}", re.ASCII)
_LOCK, _FILES = "in-use", "files"
# Holds what names a system that runs, from its start to its end, and no other.
_BOOT = Path("/proc/sys/kernel/random/boot_id")
# Where this process has looked for folders that were left.
_swept: set[Path] = set()


@contextmanager
def removed_on_abort(folder: Path) -> Iterator[Path]:
    """While the block runs, `remove_temporary_folders` removes `folder`, which was just made; else
    the caller removes it."""
    _folders[folder] = _which(folder)
    try:
        yield folder
    finally:
        _folders.pop(folder, None)


@contextmanager
def temporary_folder(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """A fresh folder in `parent`, else where the system has such, removed with what is in it.

    prefix: `rhytid-`, or a word and a hyphen after it.
    """
    if parent is None:
        _remove_left(Path(tempfile.gettempdir()))
    made = TemporaryDirectory(prefix=prefix, dir=parent)
    whole = Path(made.name)
    held = nullcontext(whole) if parent is not None else _held(whole)
    # Known until it is gone: a process that ends while it is removed removes the rest.
    with removed_on_abort(whole), held as folder, made:
        try:
            yield folder
        except MemoryError as error:
            # To remove a folder takes memory, too: what ran out of it lets go of what it made.
            traceback.clear_frames(error.__traceback__)
            raise


@contextmanager
def _held(folder: Path) -> Iterator[Path]:
    """Hold the lock of a folder, which was just made; gives the one in it for files. The lock has
    its name once it is locked: before, nobody takes the folder for one that was left."""
    files = folder / _FILES
    files.mkdir(mode=0o700)
    if sys.platform == "win32":
        yield files
        return
    aside = folder / f"{_LOCK}.new"
    descriptor = os.open(aside, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        # Without locks, a name of the system or room for it, no folder is ever taken for left.
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.write(descriptor, _kind(folder).text())
            aside.rename(folder / _LOCK)
        yield files
    finally:
        os.close(descriptor)


def _remove_left(parent: Path) -> None:
    """Remove folders of this user whose processes were killed; once in a process."""
    if sys.platform == "win32" or parent in _swept:
        return
    _swept.add(parent)
    with suppress(OSError):
        for entry in os.scandir(parent):
            if _OURS.fullmatch(entry.name):
                with suppress(OSError):  # in use, or gone
                    _remove_unless_held(Path(entry.path))


def _remove_unless_held(folder: Path) -> None:
    found = folder.lstat()
    if found.st_uid != os.getuid() or not is_marked(folder, _kind(folder)):
        return
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(descriptor)


def _kind(folder: Path) -> FolderKind:
    """What a folder that was made here and now is marked as. Raises OSError where the system does
    not tell.

    With another system, or another mount of the files, locks may not be shared; a copy has none.
    """
    device, number = _which(folder)
    here = f"folder {number} of device {device} in boot {_BOOT.read_text().strip()}"
    return FolderKind(f"rhytid temporary folder: {here}", marker=_LOCK)


def remove_temporary_folders() -> None:
    """Remove every folder of unfinished work, in a process that does not run its blocks to their
    end."""
    for _ in range(_TRIES):
        left = [folder for folder in _folders.copy() if not _removed(folder)]
        if not left:
            return
        time.sleep(_PAUSE)


def removed_at_exit(folder: Path) -> Path:
    """Have `folder`, which was just made, removed when the process ends; returns it."""
    _folders[folder] = _which(folder)
    atexit.register(_removed, folder)
    return folder


def _removed(folder: Path) -> bool:
    """Remove a folder, unless another has its name now; whether it is gone."""
    try:
        if _which(folder) != _folders.get(folder):
            return True
    except FileNotFoundError:
        return True
    shutil.rmtree(folder, ignore_errors=True)
    return not folder.exists()


def _which(folder: Path) -> tuple[int, int]:
    found = folder.lstat()
    return found.st_dev, found.st_ino
