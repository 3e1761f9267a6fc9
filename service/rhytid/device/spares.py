"""Released memory, kept for the next buffer of the same size.

A driver hands out fresh pages, and touching each for the first time costs as much as copying it:
for a map that is drawn and given back every frame, a second map copy.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

# Bytes that may lie spare beside the budget, all sizes together.
MOST_SPARE = 256 << 20


class Spares:
    """Handles by size. Safe on an in-order queue: who takes one is enqueued behind who left it."""

    def __init__(self, limit: int = MOST_SPARE) -> None:
        self._limit = limit
        self._held = 0
        self._handles: OrderedDict[int, list[Any]] = OrderedDict()

    def take(self, nbytes: int) -> Any | None:
        """A handle of exactly that size, or None."""
        handles = self._handles.get(nbytes)
        if not handles:
            return None
        self._held -= nbytes
        return handles.pop()

    def leave(self, handle: Any, nbytes: int) -> None:
        """Keep a handle, in place of those of the sizes that were left longest ago."""
        self._handles.setdefault(nbytes, []).append(handle)
        self._handles.move_to_end(nbytes)
        self._held += nbytes
        while self._held > self._limit:
            size, handles = next(iter(self._handles.items()))
            if not handles:
                del self._handles[size]
                continue
            handles.pop().release()
            self._held -= size

    def clear(self) -> None:
        """Give everything back to the driver."""
        for handles in self._handles.values():
            for handle in handles:
                handle.release()
        self._handles.clear()
        self._held = 0
