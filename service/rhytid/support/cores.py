"""Work of the host on all cores, by one pool of threads per process."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

T = TypeVar("T")
U = TypeVar("U")


def core_count() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def on_all_cores(work: Callable[[T], U], items: Sequence[T]) -> Iterator[U]:
    """Yield `work` of each item, in order. `work` spends its time in code that lets other threads
    run, and calls no `on_all_cores` itself. Raises what `work` raises; items that have not begun
    are dropped then."""
    if len(items) < 2 or core_count() == 1:
        yield from map(work, items)
        return
    # As many at a time as there are cores: what another thread asks for waits for no more of these.
    begun = deque[Future[U]]()
    try:
        for item in items:
            if len(begun) == core_count():
                yield begun.popleft().result()
            begun.append(_pool().submit(work, item))
        while begun:
            yield begun.popleft().result()
    finally:
        for one in begun:
            one.cancel()


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(core_count(), "rhytid-cores")
