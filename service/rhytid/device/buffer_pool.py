"""Released memory, kept for the next buffer of the same size.

A driver allocates fresh pages, and the first write to each costs as much as a copy: a second map
copy for a map that is drawn and released in every frame.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

# Bytes of spare buffers of all sizes; with those in use they never exceed the budget.
MOST_SPARE = 256 << 20


class BufferPool:
    """Handles by size, `held` bytes in all. Safe on an in-order queue: work on a reused buffer is
    enqueued after the work before its release."""

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
        handle = handles.pop()
        if not handles:
            del self._handles[nbytes]
        return handle

    def leave(self, handle: Any, nbytes: int) -> None:
        """Keep a handle; the sizes released longest ago are freed for it."""
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
