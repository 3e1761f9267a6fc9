"""What changes of assets and frames, counted in memory that another process can read: whoever keeps
what a tile was asks here, without a call, whether it still is. It says here, too, that the asset
was asked for."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

# Places that changes are counted in. Assets and frames that share one by chance are taken for
# changed together.
_PLACES = 4096
# Bytes of all counts, of changes that have begun and of those that have ended, and of times.
SIZE = 3 * 8 * _PLACES


@dataclass(frozen=True)
class Mark:
    """The counts of an asset and of a frame of it at one time.

    changes: where they were read.  begun, ended: changes of both.
    """

    changes: Changes
    begun: tuple[int, int]
    ended: tuple[int, int]

    @property
    def settled(self) -> bool:
        """Whether no change was under way. What is read after such a mark is true for as long as
        the mark stays the same."""
        return self.begun == self.ended


class Changes:
    """Counts in `memory`, whose bytes are 0 at first. One process writes them; another that maps
    the same memory reads them, and writes when assets were asked for. Safe from any thread."""

    def __init__(self, memory: memoryview) -> None:
        whole = memory[:SIZE].cast("B")
        counts = whole[: 2 * 8 * _PLACES].cast("Q")
        self._begun, self._ended = counts[:_PLACES], counts[_PLACES:]
        self._used = whole[2 * 8 * _PLACES :].cast("d")
        self._lock = threading.Lock()

    @contextmanager
    def changing(self, asset: str, frame: str = "") -> Iterator[None]:
        """Count the block as a change of a frame of an asset, or else of all of the asset."""
        at = _place(asset, frame)
        with self._lock:
            self._begun[at] += 1
        try:
            yield
        finally:
            with self._lock:
                self._ended[at] += 1

    def mark(self, asset: str, frame: str) -> Mark:
        """The counts now."""
        whole, one = _place(asset, ""), _place(asset, frame)
        # Those that ended first: a change that begins in between leaves the mark unsettled.
        ended = self._ended[whole], self._ended[one]
        return Mark(self, (self._begun[whole], self._begun[one]), ended)

    def use(self, asset: str) -> None:
        """Say that an asset is used now, by who answers for it without a call."""
        self._used[_place(asset, "")] = time.monotonic()

    def used(self, asset: str) -> float:
        """When `use` was last called for an asset, or for one that shares its place, in seconds of
        time.monotonic, which all processes of a machine share; 0 for never."""
        return self._used[_place(asset, "")]


def _place(asset: str, frame: str) -> int:
    # Not `hash`, which differs from process to process.
    return zlib.crc32(f"{asset}/{frame}".encode()) % _PLACES


# Of this process, whichever of its engines has the asset.
_counted = Changes(memoryview(bytearray(SIZE)))


def count_in(memory: memoryview) -> None:
    """Count in this memory from now on; called before there is an engine."""
    global _counted
    _counted = Changes(memory)


def counted() -> Changes:
    """The changes of this process."""
    return _counted
