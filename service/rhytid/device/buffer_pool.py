"""Released memory, kept for the next buffer of the same size.

A driver hands out fresh pages, and touching each for the first time costs as much as copying it:
for a map that is drawn and given back every frame, a second map copy.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

# Bytes that may lie spare, all sizes together; together with what is in use never over the budget.
MOST_SPARE = 256 << 20


class BufferPool:
    """Handles by size, `held` bytes in all. Safe on an in-order queue: who takes one is enqueued
    behind who left it."""

    def __init__(self, limit: int = MOST_SPARE) -> None:
        self._limit = limit
        self.held = 0
        self._handles: OrderedDict[int, list[Any]] = OrderedDict()

    def take(self, nbytes: int) -> Any | None:
        """A handle of exactly that size, or None."""
        handles = self._handles.get(nbytes)
        if not handles:
            return None
        self.held -= nbytes
        return handles.pop()

    def leave(self, handle: Any, nbytes: int) -> None:
        """Keep a handle, in place of those of the sizes that were left longest ago."""
        self._handles.setdefault(nbytes, []).append(handle)
        self._handles.move_to_end(nbytes)
        self.held += nbytes
        self.shrink(self._limit)

    def shrink(self, limit: int) -> None:
        """Give back to the driver what is over `limit` bytes, sizes left longest ago first."""
        while self.held > limit:
            size, handles = next(iter(self._handles.items()))
            if not handles:
                del self._handles[size]
                continue
            handles.pop().release()
            self.held -= size
