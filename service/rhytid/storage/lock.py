"""One process per store, or per file: a lock that the system releases when its holder ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from rhytid.errors import StorageError

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


class FileLock:
    """An exclusive hold on a file, which is made where it is not there, until `release`.

    The file stays: removing it would let two holders lock two files of the same name.
    Raises StorageError with `refusal` where another holder, in this process or in another, has it.
    """

    def __init__(self, path: Path, refusal: str) -> None:
        self._descriptor = os.open(path, _FLAGS, 0o600)
        try:
            _claim(self._descriptor)
        except OSError as exc:
            self.release()
            raise StorageError(refusal) from exc

    def release(self) -> None:
        """Let go; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class FolderLock(FileLock):
    """The same on the file `lock` of a store's `folder`; the error names the folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / LOCK, f"store {folder} is in use by another rhytid server")
