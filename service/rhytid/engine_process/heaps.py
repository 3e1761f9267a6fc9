"""Memory of the C library: few heaps, and what is free in them goes back to the system.

An engine allocates on many threads: arrays of all sizes, beside what the compiler leaves behind.
By itself glibc makes 8 heaps per core, each with gaps of its own, and gives back the end of a heap
alone: after 15 minutes of mixed load on two cores 17 heaps took 300 MiB. Other C libraries have no
such settings; there nothing is done.
"""

from __future__ import annotations

import ctypes
import threading
from functools import cache
from typing import Any

# Of mallopt. Python runs one thread at a time, and the kernels of PoCL allocate nothing.
_ARENA_MAX, _ARENAS = -8, 2
# Seconds between two times that free memory is given back, which takes milliseconds.
PAUSE = 30.0


@cache
def _known(name: str) -> Any:
    """A function of the C library; None where it has no such."""
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):
        return None


def keep_few() -> None:
    """Have the C library make _ARENAS heaps at most, from now on."""
    if (setting := _known("mallopt")) is not None:
        setting(_ARENA_MAX, _ARENAS)


def give_back() -> None:
    """Give what is free in heaps back to the system."""
    if (trim := _known("malloc_trim")) is not None:
        trim(ctypes.c_size_t(0))


def keep_giving_back(end: threading.Event) -> None:
    """`give_back` every so often on a thread of its own, until `end` is set."""

    def work() -> None:
        while not end.wait(PAUSE):
            give_back()

    threading.Thread(target=work, name="rhytid-heaps", daemon=True).start()
