"""Work of the host on all cores, by one pool of threads per process."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any, Generic, TypeVar

T = TypeVar("T")
U = TypeVar("U")
# Seconds after which work gives way to what others have asked for meanwhile.
_TURN = 0.02


def core_count() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def on_all_cores(work: Callable[[T], U], items: Sequence[T]) -> list[U]:
    """`work` of each item, in their order. `work` spends its time in code that lets other threads
    run, and calls no `on_all_cores` itself. Raises what `work` raises, of the first item that has
    failed; items that have not begun are dropped then."""
    if len(items) < 2 or core_count() == 1:
        return [work(item) for item in items]
    return _Shared(work, items).done()


class _Shared(Generic[T, U]):
    """Items that the threads of the pool take one after the other: to hand over each by itself
    wakes two threads."""

    def __init__(self, work: Callable[[T], U], items: Sequence[T]) -> None:
        self._work, self._items = work, items
        self._found: dict[int, U] = {}
        self._errors: dict[int, BaseException] = {}
        # Taken from by all threads, of which one runs Python at a time.
        self._next = iter(range(len(items)))

    def done(self) -> list[U]:
        count = min(core_count(), len(self._items))
        threads = [_pool().submit(self._turn) for _ in range(count)]
        try:
            while threads:
                again = threads.pop(0).result()
                if again is not None:
                    threads.append(again)
        finally:
            self._next = iter(range(0))
        if self._errors:
            first = self._errors[min(self._errors)]
            self._errors.clear()
            self._found.clear()
            try:
                raise first
            finally:  # else it and the frames in its traceback hold each other
                del first
        return [self._found[number] for number in range(len(self._items))]

    def _turn(self) -> Future[Any] | None:
        """Work on items. Where some are left after a turn, the next one, at the end of the
        queue."""
        until = time.monotonic() + _TURN
        while (number := next(self._next, None)) is not None:
            try:
                self._found[number] = self._work(self._items[number])
            except BaseException as error:  # noqa: BLE001 raised where the work was asked for
                self._errors[number] = error
                self._next = iter(range(0))
            if time.monotonic() > until:
                return _pool().submit(self._turn)
        return None


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(core_count(), "rhytid-cores")
