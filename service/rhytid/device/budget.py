"""A memory budget of our own, since drivers allocate more than the device has, and the pool of
spare memory that it counts."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Protocol, TypeVar

from rhytid.errors import DeviceMemoryError

# Bytes of spare buffers of all sizes; with those in use they never exceed the budget.
MOST_SPARE = 256 << 20


class Releasable(Protocol):
    """Something on the device that can be freed."""

    def release(self) -> None:
        """Give the memory back."""
        ...


T = TypeVar("T", bound=Releasable)


class MemoryBudget:
    """Counts bytes on the device, and makes room by dropping entries that can be made again.

    `used` leaves spare memory out, but both together stay within `limit`: spare memory is freed
    first.

    Entries are dropped least recently used first, but never in the task that used them: `new_task`
    says that no task uses earlier ones any more.  dropped: called with the key of each entry that
    is dropped.
    """

    def __init__(
        self, limit: int, spares: BufferPool, dropped: Callable[[Hashable], None] | None = None
    ) -> None:
        self.limit = limit
        self.used = 0
        self._pool, self._dropped = spares, dropped
        self._kept: OrderedDict[Hashable, Releasable] = OrderedDict()
        self._in_hands: set[Hashable] = set()
        self._made: set[Hashable] = set()

    def new_task(self) -> None:
        """Begin a task: entries that were kept or found before may be dropped again when memory is
        short."""
        self._in_hands.clear()
        self._made.clear()

    def forget_made(self) -> None:
        """Release the entries that were made since `new_task`, because the task failed."""
        self.drop(self._made.__contains__)

    def reserve(self, nbytes: int, *, reuse: bool = False) -> Any | None:
        """Count `nbytes` in, and drop entries where needed; raises DeviceMemoryError where they do
        not fit even so.

        reuse: return spare memory of exactly that size, or None where there is none. The memory of
        entries that were dropped just now is spare, too.
        """
        if self.used + nbytes > self.limit:
            self._make_room(nbytes)
        if self.used + nbytes > self.limit:
            raise DeviceMemoryError(
                f"{nbytes} bytes more than the {self.used} in use would pass the device memory "
                f"budget of {self.limit} bytes (RHYTID_DEVICE_MEMORY_MB)"
            )
        self.used += nbytes
        spare = self._pool.take(nbytes) if reuse else None
        self._pool.shrink(self.limit - self.used)
        return spare

    def free(self, nbytes: int) -> None:
        """Count `nbytes` out."""
        self.used -= nbytes

    def keep(self, key: Hashable, make: Callable[[], T]) -> T:
        """The entry of `key`. It is made, and kept from then on, where there is none."""
        found = self._kept.get(key)
        if found is None:
            found = make()
            self._kept[key] = found
            self._made.add(key)
        self._use(key)
        return found  # type: ignore[return-value]

    def find(self, key: Hashable) -> Any | None:
        """The entry of `key`, or None; it stays until the task ends."""
        found = self._kept.get(key)
        if found is not None:
            self._use(key)
        return found

    def discard(self, key: Hashable) -> None:
        """Release the entry of `key`, if there is one."""
        found = self._kept.pop(key, None)
        if found is not None:
            found.release()

    def drop(self, belongs: Callable[[Hashable], bool]) -> None:
        """Release every entry whose key `belongs`."""
        for key in [k for k in self._kept if belongs(k)]:
            self.discard(key)

    def _use(self, key: Hashable) -> None:
        self._kept.move_to_end(key)
        self._in_hands.add(key)

    def _make_room(self, nbytes: int) -> None:
        for key in [k for k in self._kept if k not in self._in_hands]:
            if self.used + nbytes <= self.limit:
                return
            self.discard(key)
            if self._dropped is not None:
                self._dropped(key)


class BufferPool:
    """Released memory by size, kept for the next buffer of the same size; `held` counts its bytes.
    Safe on an in-order queue: work on a reused buffer is enqueued after the work before its
    release.

    A driver allocates fresh pages, and the first write to each costs as much as a copy: without a
    pool, a map that is drawn and released in every frame costs a second map copy.
    """

    def __init__(self, limit: int = MOST_SPARE) -> None:
        self._limit = limit
        self.held = 0
        self._handles: OrderedDict[int, list[Any]] = OrderedDict()

    def take(self, nbytes: int) -> Any | None:
        """A handle of exactly `nbytes` bytes, or None."""
        handles = self._handles.get(nbytes)
        if not handles:
            return None
        self.held -= nbytes
        handle = handles.pop()
        if not handles:
            del self._handles[nbytes]
        return handle

    def leave(self, handle: Any, nbytes: int) -> None:
        """Keep a handle; handles of the sizes that were left longest ago are freed for it."""
        self._handles.setdefault(nbytes, []).append(handle)
        self._handles.move_to_end(nbytes)
        self.held += nbytes
        self.shrink(self._limit)

    def shrink(self, limit: int) -> None:
        """Free handles until `limit` bytes are held at most, of the sizes that were left longest
        ago first."""
        while self.held > limit:
            size, handles = next(iter(self._handles.items()))
            if not handles:
                del self._handles[size]
                continue
            handles.pop().release()
            self.held -= size
