"""The keys as a server knows them: read again when their file changes."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from rhytid.access.api_key import ApiKey, key_id, proves, utc_now
from rhytid.access.key_file import read_keys
from rhytid.errors import StorageError

# Seconds between two looks at the file.
EVERY = 1.0
_log = logging.getLogger(__name__)


class KeyRing:
    """The keys of a file. For one thread.

    Who shows none is let in as long as there has never been a file; once one was seen a key is
    asked for, even when it is gone again. A file that cannot be read lets nobody in.

    asked: True = a key is asked for whether there is a file or not.  every: seconds.
    """

    def __init__(self, path: Path, *, asked: bool = False, every: float = EVERY) -> None:
        self._path, self._every, self._asked = path, every, asked
        self._keys: dict[str, ApiKey] = {}
        # What the file was when it was read; None = it is to be read.
        self._seen: tuple[int, ...] | None = None
        self._trouble = ""
        self._next = 0.0

    @property
    def asked(self) -> bool:
        """Whether a key is asked for now."""
        self._look()
        return self._asked

    def find(self, shown: bytes) -> ApiKey | None:
        """The valid key that was shown, if it is one; raises StorageError where the file cannot be
        read."""
        self._look()
        if self._trouble:
            raise StorageError(f"the API keys of {self._path} cannot be read")
        kept = self._keys.get(key_id(shown) or "")
        return kept if proves(shown, kept) and kept is not None and kept.valid(utc_now()) else None

    def _look(self) -> None:
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + self._every
        seen = self._mark()
        if seen is None or seen != self._seen:
            self._seen = seen
            self._read()

    def _read(self) -> None:
        self._keys, before, self._trouble = {}, self._trouble, ""
        try:
            self._keys = {key.id: key for key in read_keys(self._path)}
            self._asked = True
        except FileNotFoundError:
            pass
        except StorageError as error:
            self._trouble, self._asked, self._seen = str(error), True, None
            if self._trouble != before:
                _log.error("nobody is let in: %s", error)

    def _mark(self) -> tuple[int, ...] | None:
        """What of a file changes with it: nothing where there is none, None where it cannot be
        seen."""
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return ()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size
