"""Memory that was freed and that the C library keeps for later."""

from __future__ import annotations

import ctypes
import sys


def give_back_heap() -> None:
    """Give the system what malloc keeps of freed memory.

    By itself glibc gives back the end of a heap alone. It keeps blocks of up to 32 MB, half a
    gigabyte of them after a long synthesis, which larger blocks cannot use. To use them again
    touches fresh memory, so this is for the end of a step, before one that needs much, or for every
    so often. Elsewhere than on glibc nothing happens.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(ctypes.c_size_t(0))
