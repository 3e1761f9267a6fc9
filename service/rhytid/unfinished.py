"""Folders of work that is not finished, so that a process that ends at once can remove them."""

from __future__ import annotations

import atexit
import shutil
import time
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
def unfinished(folder: Path) -> Iterator[Path]:
    """While the block runs, `folder`, which was just made, counts as unfinished; the caller removes
    it."""
    _folders[folder] = _which(folder)
    try:
        yield folder
    finally:
        _folders.pop(folder, None)


@contextmanager
def temporary_folder(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """A fresh folder in `parent`, else where the system has such, removed with what is in it."""
    with TemporaryDirectory(prefix=prefix, dir=parent) as name, unfinished(Path(name)) as folder:
        yield folder


def remove_unfinished() -> None:
    """Remove all of them; for a process that does not run its blocks to their end."""
    for _ in range(_TRIES):
        left = [folder for folder in _folders.copy() if not _removed(folder)]
        if not left:
            return
        time.sleep(_PAUSE)


def until_exit(folder: Path) -> Path:
    """The folder itself, which was just made, and is removed when the process ends."""
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
