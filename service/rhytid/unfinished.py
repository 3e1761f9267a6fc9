"""Folders of work that is not finished, so that a process that ends at once can remove them."""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

_folders: set[Path] = set()
# Another thread may still write into a folder while it is removed.
_TRIES = 5


@contextmanager
def unfinished(folder: Path) -> Iterator[Path]:
    """While the block runs, `folder` counts as unfinished; the caller removes it."""
    _folders.add(folder)
    try:
        yield folder
    finally:
        _folders.discard(folder)


@contextmanager
def temporary_folder(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """A fresh folder in `parent`, else where the system has such, removed with what is in it."""
    with TemporaryDirectory(prefix=prefix, dir=parent) as name, unfinished(Path(name)) as folder:
        yield folder


def remove_unfinished() -> None:
    """Remove all of them; for a process that does not run its blocks to their end."""
    for _ in range(_TRIES):
        for folder in list(_folders):
            shutil.rmtree(folder, ignore_errors=True)
        if not any(folder.exists() for folder in list(_folders)):
            return


def until_exit(folder: Path) -> Path:
    """The folder itself, which is removed when the process ends."""
    _folders.add(folder)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
