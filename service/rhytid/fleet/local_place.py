"""A place on this machine for what a replica has of the assets: as many as there are replicas."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from itertools import count
from pathlib import Path

from rhytid.durable import reported
from rhytid.errors import StorageError


class LocalPlace:
    """A folder that one replica has while it lives; what another left there is removed.

    number: from 0 on, another for each replica of the machine.
    """

    def __init__(self, folder: Path | None) -> None:
        place = usual_folder() if folder is None else folder
        with reported(f"{place} cannot be used"):
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            _check_owner(place)
            self.number = next(number for number in count() if self._taken(place, number))
            self.store = place / str(self.number)
            shutil.rmtree(self.store, ignore_errors=True)

    def _taken(self, place: Path, number: int) -> bool:
        descriptor = os.open(place / f"{number}.lock", os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        # Held until this process ends.
        self._descriptor = descriptor
        return True

    def close(self) -> None:
        """Leave the place to another."""
        shutil.rmtree(self.store, ignore_errors=True)
        os.close(self._descriptor)


def usual_folder() -> Path:
    """Where replicas keep their assets where nothing else is said."""
    return Path(tempfile.gettempdir()) / f"rhytid-replicas-{os.getuid()}"


def _check_owner(place: Path) -> None:
    # Others may make a folder of that name in the system's folder for temporary files.
    found = place.lstat()
    if place.is_symlink() or found.st_uid != os.getuid():
        raise StorageError(f"{place} belongs to somebody else: name another folder")
