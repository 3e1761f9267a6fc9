"""Files of which ranges are asked for: written to disk once and kept while they are asked for, so
that a download in many ranges costs the file once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rhytid.api.admission import in_turn
from rhytid.api.spool import Spool
from rhytid.engine.byte_budget import ByteBudget

# Seconds for which a file is kept that nobody reads.
IDLE = 60.0
# The share of the budget that kept files may have.
_SHARE = 2

Pieces = Sequence[bytes | memoryview]


@dataclass(eq=False)
class _Kept:
    """A file that is written, or being so under `writing`.  users: requests that read it or wait
    for it.  leaves: drops it once nobody has for a while."""

    writing: threading.Lock = field(default_factory=threading.Lock)
    spool: Spool | None = None
    users: int = 0
    leaves: threading.Timer | None = None


@dataclass(frozen=True)
class WrittenFile:
    """A file that one request reads, until `close`.  nbytes: its size."""

    nbytes: int
    _spool: Spool
    _leave: Callable[[], None]

    def within(self, asked: range, size: int) -> Iterator[bytes]:
        """The bytes of a range, so many at a time."""
        starts = range(asked.start, asked.stop, size)
        return (self._spool.read(at, min(size, asked.stop - at)) for at in starts)

    def close(self) -> None:
        """Let others drop the file."""
        self._leave()


class WrittenFiles:
    """Files by their ETag, without a name on disk. Safe from any thread.

    budget: of disk that they are counted in; those that nobody reads leave it when a request waits
    for bytes of it, and after `seconds`.  folder: of the files, or where temporary files are if it
    does not exist.
    """

    def __init__(self, budget: ByteBudget, folder: Path, seconds: float = IDLE) -> None:
        self._budget, self._folder, self._seconds = budget, folder, seconds
        self._lock = threading.Lock()
        self._kept: dict[str, _Kept] = {}
        budget.on_shortage = self.clear

    def opened(
        self, tag: str, nbytes: int, write: Callable[[], Pieces | None]
    ) -> WrittenFile | None:
        """The file with this ETag, which `write` gives unless it is kept; who asks while another
        has it written waits for the same. None where the disk has no room for it now, or `write`
        gives None. Raises what `write` raises, HostBusyError where another writes for too long, and
        CancelledError where the client is gone meanwhile.

        nbytes: about as many as it has.
        """
        file = self._used(tag)
        try:
            with in_turn(file.writing, "another request wrote this file"):
                if file.spool is None and self._has_room(nbytes):
                    file.spool = self._spooled(write())
        except BaseException:
            self._left(tag, file)
            raise
        return self._read(tag, file)

    def kept(self, tag: str) -> WrittenFile | None:
        """The file with this ETag; None where it is not written yet, or not kept. Does not wait."""
        return self._read(tag, self._used(tag))

    def _read(self, tag: str, file: _Kept) -> WrittenFile | None:
        """The file for one of its users, who leaves it at once where there is none."""
        if file.spool is None:
            self._left(tag, file)
            return None
        return WrittenFile(file.spool.size, file.spool, lambda: self._left(tag, file))

    def clear(self) -> None:
        """Drop the files that nobody reads."""
        with self._lock:
            idle = [(tag, file) for tag, file in self._kept.items() if not file.users]
        for tag, file in idle:
            self._drop(tag, file)

    def _has_room(self, nbytes: int) -> bool:
        kept = sum(file.spool.size for file in [*self._kept.values()] if file.spool is not None)
        return kept + nbytes <= self._budget.limit // _SHARE and self._budget.has(nbytes)

    def _spooled(self, pieces: Pieces | None) -> Spool | None:
        if pieces is None:
            return None
        spool = Spool.at(self._folder, self._budget.hold("answers"))
        return spool if spool.filled(pieces, "a file is written for each range of it") else None

    def _used(self, tag: str) -> _Kept:
        with self._lock:
            file = self._kept.setdefault(tag, _Kept())
            file.users += 1
            if file.leaves is not None:
                file.leaves.cancel()
        return file

    def _left(self, tag: str, file: _Kept) -> None:
        with self._lock:
            file.users -= 1
            if file.users:
                return
            if file.spool is None:
                self._kept.pop(tag, None)
                return
            file.leaves = threading.Timer(self._seconds, self._drop, (tag, file))
            file.leaves.daemon = True
            file.leaves.start()

    def _drop(self, tag: str, file: _Kept) -> None:
        with self._lock:
            if file.users or self._kept.get(tag) is not file:
                return
            del self._kept[tag]
            if file.leaves is not None:
                file.leaves.cancel()
        if file.spool is not None:
            file.spool.close()
