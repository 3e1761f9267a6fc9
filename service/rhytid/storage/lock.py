"""One process per store: a lock that the system releases when its holder ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from rhytid.errors import StorageError

if sys.platform == "win32":
    import msvcrt

    def _claim(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _claim(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class FolderLock:
    """An exclusive hold on `folder` through the file `lock` in it, until `release`.

    The file stays: removing it would let two holders lock two files of the same name.
    Raises StorageError naming the folder where another holder, in this process or in another,
    has it.
    """

    def __init__(self, folder: Path) -> None:
        self._descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _claim(self._descriptor)
        except OSError as exc:
            self.release()
            raise StorageError(f"store {folder} is in use by another rhytid server") from exc

    def release(self) -> None:
        """Let go; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
