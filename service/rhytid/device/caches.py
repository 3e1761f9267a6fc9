"""Gives OpenCL drivers a folder for compiled kernels where the user's own cannot be written.

PoCL lists no device without such a folder, and pyopencl fails while it says that it has none. Both
look in XDG_CACHE_HOME and in the home, which a service account or a container may lack.
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from rhytid.support.temporary_folders import removed_at_exit

# Folders that PoCL and pyopencl make there: one of another owner is as bad as none.
_MADE = ("pocl/kcache", "pyopencl", "pytools")
# The lock that pyopencl holds, for milliseconds, while it reads or writes a program. A process that
# is killed meanwhile leaves it, and every compilation of this user would wait for it for a minute.
_LOCKS = "pyopencl/pyopencl-compiler-cache-*/lock"
# Seconds after which one that did not change is of a process that is gone, and between two looks.
_HELD, _LOOK = 1.0, 0.02


def provide_cache_folder() -> Path | None:
    """Set XDG_CACHE_HOME to a folder of our own where kernels could not be kept otherwise; returns
    the folder of caches, None off Linux.

    Where no folder at all can be written, tell pyopencl to keep none.
    """
    # Else pyopencl raises a KeyError where its cache fails, as it may beside other processes.
    os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
    if sys.platform != "linux":
        return None
    usual = _usual_folder()
    folder = usual if usual is not None and _keeps(usual) else _own_folder()
    if folder is None:
        os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    elif (
        folder != usual or "HOME" not in os.environ
    ):  # PoCL does not look up the home folder by itself
        os.environ["XDG_CACHE_HOME"] = str(folder)
    return folder


def free_programs() -> None:
    """Remove the locks of pyopencl's compiled programs that killed processes have left."""
    folder = _usual_folder()
    if sys.platform != "linux" or folder is None:
        return
    for lock in folder.glob(_LOCKS):
        with suppress(OSError):
            seen, until = _which(lock), time.monotonic() + _HELD
            while _which(lock) == seen:
                if time.monotonic() > until:
                    lock.unlink()
                    break
                time.sleep(_LOOK)


def _which(file: Path) -> tuple[int, int]:
    """Identifies a file; another file in its place has another number."""
    found = file.stat()
    return found.st_ino, found.st_ctime_ns


def provide_places(folder: Path) -> Path | None:
    """Have compiled kernels, and temporary files, go into `folder` where the usual places for them
    cannot be written: a container with a read-only root and no home.

    Returns the folder where kernels are kept instead, else None. To be called before OpenCL is
    loaded.
    """
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        place = folder / "tmp"
        if writable(place):
            tempfile.tempdir = os.environ["TMPDIR"] = str(place.absolute())
    usual = _usual_folder()
    if sys.platform != "linux" or (usual is not None and _keeps(usual)) or not _keeps(folder):
        return None
    os.environ["XDG_CACHE_HOME"] = str(folder.absolute())
    return folder


def _usual_folder() -> Path | None:
    """The usual folder of caches; None for a user without a home."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None


def _keeps(folder: Path) -> bool:
    made = (folder / name for name in _MADE)
    return writable(folder) and all(writable(path) for path in made if os.path.lexists(path))


def writable(folder: Path) -> bool:
    """Whether files can be made in a folder; the folder is made where it does not exist."""
    try:
        folder.mkdir(0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _own_folder() -> Path | None:
    """A folder of this user among the temporary files, kept for the next start; where another
    user's is in its place, one that goes with the process."""
    try:
        folder = Path(tempfile.gettempdir()) / f"rhytid-cache-{os.getuid()}"
        if writable(folder) and _is_private(folder) and _keeps(folder):
            return folder
        return removed_at_exit(Path(tempfile.mkdtemp(prefix="rhytid-cache-")))
    except OSError:
        return None


def _is_private(folder: Path) -> bool:
    """Whether no other user can write compiled code there."""
    found = folder.lstat()
    mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return mine and not stat.S_IMODE(found.st_mode) & 0o077
