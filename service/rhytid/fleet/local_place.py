"""A place on this machine for what a replica has of the assets: as many as there are replicas."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from itertools import count
from pathlib import Path

from rhytid.errors import StorageError
from rhytid.support.atomic_files import claim, storage_errors
from rhytid.support.ownership import FolderKind, is_marked, is_real_folder, make_folder, not_owned

# With a marker of its own, so that no store of a server is taken for what a replica had.
REPLICA = FolderKind("rhytid replica", marker="replica.json")


class LocalPlace:
    """A folder that one replica has while it lives; what another left there is removed, as its
    marker says that a replica had it.

    number: from 0 on, another for each replica of the machine. Raises StorageError where the folder
    of the replica is not ours; it is left alone then.
    """

    def __init__(self, folder: Path | None) -> None:
        place = usual_folder() if folder is None else folder
        with storage_errors(f"{place} cannot be used"):
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            _check_owner(place)
            self.number = next(number for number in count() if self._taken(place, number))
            self.store = place / f"replica-{self.number}"
            try:
                self._remove()
                make_folder(self.store)
                claim(self.store, REPLICA)
            except BaseException:
                os.close(self._descriptor)
                raise

    def _taken(self, place: Path, number: int) -> bool:
        flags = os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
        descriptor = os.open(place / f"replica-{number}.lock", flags, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        # Held until this process ends.
        self._descriptor = descriptor
        return True

    def _remove(self) -> None:
        """Remove what a replica left; raises StorageError where somebody else did."""
        if is_marked(self.store, REPLICA):
            shutil.rmtree(self.store, ignore_errors=True)
        if not os.path.lexists(self.store):
            return
        if not is_real_folder(self.store) or any(self.store.iterdir()):
            raise not_owned(self.store)

    def close(self) -> None:
        """Leave the place to another."""
        if is_marked(self.store, REPLICA):
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
