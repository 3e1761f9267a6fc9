"""Folders of unfinished work, so that a process that ends at once can remove them."""

from __future__ import annotations

import atexit
import shutil
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

# Of each which folder it is, so that no other is removed that has its name by then.
_folders: dict[Path, tuple[int, int]] = {}
# Another thread, or a process that is ending, may still write into a folder while it is removed:
# how often that is tried, and the seconds between two tries.
_TRIES, _PAUSE = 10, 0.02


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
    """A fresh folder in `parent`, else where the system has such, removed with what is in it."""
    made = TemporaryDirectory(prefix=prefix, dir=parent)
    # Known until it is gone: a process that ends while it is removed removes the rest.
    with removed_on_abort(Path(made.name)) as folder, made:
        try:
            yield folder
        except MemoryError as error:
            # To remove a folder takes memory, too: what ran out of it lets go of what it made.
            traceback.clear_frames(error.__traceback__)
            raise


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
