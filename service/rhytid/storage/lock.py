"""One process per store, or per file: a lock that the system releases when its holder ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rhytid.errors import StorageError
from rhytid.support.ownership import read_plain

LOCK = "lock"

if sys.platform == "win32":
    import msvcrt

    def _claim(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _claim(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
# The name of this process in the stores that it locks: a server, unless a command says.
_SERVER = "rhytid serve"
_name = _SERVER
# The process that is named there: this one, or the server whose device this one has.
_process: int | None = None
# Bytes of a name that are read.
_LONGEST = 100


def known_by(process: int) -> None:
    """From now on this process names another in the stores that it locks: the one to end."""
    global _process
    _process = process


@contextmanager
def known_as(name: str) -> Iterator[None]:
    """Within the block, this process calls itself `name` in the stores that it locks: other
    processes that want one read the name."""
    global _name
    before, _name = _name, name
    try:
        yield
    finally:
        _name = before


class FileLock:
    """An exclusive lock on a file, until `release`; the file is made where it does not exist.

    The file stays: removing it would let two holders lock two files of the same name. Raises
    StorageError with `refusal` where another holder, in this process or in another, has the lock.
    """

    def __init__(self, path: Path, refusal: str) -> None:
        self._descriptor = os.open(path, _FLAGS, 0o600)
        try:
            _claim(self._descriptor)
        except OSError as exc:
            self.release()
            raise StorageError(refusal) from exc

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class FolderLock(FileLock):
    """A `FileLock` on the file `lock` of a store's `folder`, which names its holder; the error
    names folder and holder."""

    def __init__(self, folder: Path) -> None:
        path = folder / LOCK
        super().__init__(path, f"store {folder} is in use by {_holder(path)}")
        with suppress(OSError):  # on a full disk it is held without a name
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{_name}, process {_process or os.getpid()}\n".encode())


def _holder(path: Path) -> str:
    """The process that holds the file, as it calls itself there; earlier versions wrote no name."""
    text = ""
    with suppress(OSError):
        text = read_plain(path, _LONGEST).decode(errors="replace").strip()
    return f"another {text}" if text else "another rhytid process"
