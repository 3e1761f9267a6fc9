"""One map copy on the host: the unit of cost of what runs there beside a GPU."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np


class HostCopy:
    """Two maps of R² float32, copied by every thread of the host."""

    def __init__(self, size: int) -> None:
        count = os.cpu_count() or 1
        self._from, self._to = (
            np.array_split(np.full(size * size, value, np.float32), count) for value in (1, 0)
        )
        self._threads = ThreadPoolExecutor(count)

    def seconds(self) -> float:
        """Seconds of one copy."""
        start = time.perf_counter()
        list(self._threads.map(np.copyto, self._to, self._from))
        return time.perf_counter() - start
