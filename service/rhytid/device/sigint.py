"""SIGINT kept from the driver: from its threads, and from the programs that it starts.

PoCL links kernels by a linker of its own, which ctrl-C at a terminal reaches as well: PoCL then
ends the whole process by SIGABRT. Threads and programs inherit what their thread has blocked.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_sigint() -> Iterator[None]:
    """Within the block SIGINT is for other threads; where there is none, it comes afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
