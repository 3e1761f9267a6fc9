"""A lock for each key that is in use."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class _Used:
    lock: threading.RLock = field(default_factory=threading.RLock)
    users: int = 0


class KeyedLocks:
    """Locks by key, each removed when nobody holds it or waits for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._used: dict[Hashable, _Used] = {}

    def __len__(self) -> int:
        return len(self._used)

    @contextmanager
    def holding(self, key: Hashable) -> Iterator[None]:
        """Held by one thread at a time for each key; that thread may hold it again."""
        with self._lock:
            used = self._used.setdefault(key, _Used())
            used.users += 1
        try:
            with used.lock:
                yield
        finally:
            with self._lock:
                used.users -= 1
                if not used.users:
                    del self._used[key]
