"""Work of the host on all cores, by one pool of threads per process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
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
        return map(work, items)
    return _pool().map(work, items)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(core_count(), "rhytid-cores")
