"""The keys as a server knows them: read again when their file changes."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path

from rhytid.api.keys import ApiKey, key_id, leave_mark, proves, read_keys, utc_now
from rhytid.errors import StorageError

# Seconds between two looks at the file, and for a look that requests wait for.
EVERY, PATIENCE = 1.0, 5.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Known:
    """What the last look has found.  asked: whether a key is asked for.  trouble: why the keys
    cannot be read; empty where they can."""

    asked: bool
    keys: Mapping[str, ApiKey] = field(default_factory=dict)
    trouble: str = ""


class KeyRing:
    """The keys of a file, as of the last `look` or `fresh`. One thread asks, another may look.

    Who shows none is let in as long as there has never been a file; once one was seen a key is
    asked for, even when it is gone again. A file that cannot be read lets nobody in.

    asked: True = a key is asked for whether there is a file or not.  every: seconds between looks.
    patience: seconds that a request waits for a look.  mark: a file that is left once keys were
    read, where its folder is there; None = none.
    """

    def __init__(
        self,
        path: Path,
        *,
        asked: bool = False,
        every: float = EVERY,
        patience: float = PATIENCE,
        mark: Path | None = None,
    ) -> None:
        self._path, self._every, self._patience, self._mark = path, every, patience, mark
        self._known = _Known(asked)
        # What the file was when it was read; None = it is to be read.
        self._seen: tuple[int, ...] | None = None
        self._next = 0.0
        # The look of a thread, and until when requests wait for it.
        self._looking: Future[None] | None = None
        self._until = 0.0

    @property
    def asked(self) -> bool:
        """Whether a key is asked for."""
        return self._known.asked

    def find(self, shown: bytes) -> ApiKey | None:
        """The valid key that was shown, if it is one; raises StorageError where the file cannot be
        read."""
        known = self._known
        if known.trouble:
            raise StorageError(f"the API keys of {self._path} cannot be read")
        kept = known.keys.get(key_id(shown) or "")
        return kept if proves(shown, kept) and kept is not None and kept.valid(utc_now()) else None

    async def fresh(self) -> None:
        """Look at the file where it is time to, on a thread: its file system may hang. Nobody is
        let in while a look takes longer than `patience`."""
        if self._looking is not None and self._looking.done():
            self._looking = None
        now = time.monotonic()
        if self._looking is None:
            if now < self._next:
                return
            self._looking, self._until = self._begun(), now + self._patience
        looking = self._looking
        if not looking.done() and now < self._until:
            await asyncio.wait([asyncio.wrap_future(looking)], timeout=self._until - now)
        if not looking.done():
            rule = f"{self._path} was not read within {self._patience:g} seconds"
            self._learn(replace(self._known, asked=True, keys={}, trouble=rule))

    def _begun(self) -> Future[None]:
        """A look on a thread of its own, which ends with the process."""
        done: Future[None] = Future()

        def run() -> None:
            try:
                self.look()
            finally:
                done.set_result(None)

        threading.Thread(target=run, name="rhytid-keys", daemon=True).start()
        return done

    def look(self) -> None:
        """Look at the file where it is time to; may block."""
        if (now := time.monotonic()) < self._next:
            return
        self._next = now + self._every
        seen = self._facts()
        if seen is None or seen != self._seen or self._known.trouble:
            self._seen = seen
            self._read()

    def _read(self) -> None:
        try:
            keys = {key.id: key for key in read_keys(self._path)}
        except FileNotFoundError:
            self._learn(_Known(self._known.asked))
        except StorageError as error:
            self._seen = None
            self._learn(_Known(asked=True, trouble=str(error)))
        else:
            self._learn(_Known(asked=True, keys=keys))
            self._leave_mark()

    def _learn(self, known: _Known) -> None:
        before, self._known = self._known.trouble, known
        if known.trouble and known.trouble != before:
            _log.error("nobody is let in: %s", known.trouble)

    def _leave_mark(self) -> None:
        if self._mark is not None and self._mark.parent.is_dir():
            try:
                leave_mark(self._mark)
            except StorageError as error:
                _log.warning("%s", error)

    def _facts(self) -> tuple[int, ...] | None:
        """What of a file changes with it: nothing where there is none, None where it cannot be
        seen."""
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return ()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size
