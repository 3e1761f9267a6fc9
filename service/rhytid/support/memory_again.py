"""Memory of arrays that come again and again: the next one takes that of one that is gone.

Fresh memory is cleared by the system when it is first touched, which takes as long as a copy.
"""

from __future__ import annotations

import math
import threading
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Room = NDArray[np.uint8]


class MemoryAgain:
    """Gives arrays their memory. It comes back when neither an array nor a part of it is held any
    more, and stays for the next one of its size while a block of `kept` runs. Safe from any
    thread."""

    def __init__(self) -> None:
        self._lock, self._blocks = threading.Lock(), 0
        # By their bytes. Of its own type, since memory comes back whenever an array goes, in the
        # midst of a call here, too: no lock is taken then.
        self._spare: defaultdict[int, deque[Room]] = defaultdict(deque)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """While the block runs memory is kept; at its end, or that of the last such block, what
        nobody holds is freed."""
        with self._lock:
            self._blocks += 1
        try:
            yield
        finally:
            with self._lock:
                self._blocks -= 1
                if not self._blocks:
                    self._spare.clear()

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """As `np.empty`."""
        if not self._blocks:
            return np.empty(shape, dtype)
        nbytes = math.prod(shape) * np.dtype(dtype).itemsize
        try:
            room = self._spare[nbytes].pop()
        except IndexError:
            room = np.empty(nbytes, np.uint8)
        return np.asarray(_Lent(room, self._take_back)).view(dtype).reshape(shape)

    def _take_back(self, room: Room) -> None:
        if self._blocks:
            self._spare[room.nbytes].append(room)


class _Lent:
    """What numpy holds as long as any array lies in some memory: no array itself, in whose place
    numpy would hold the one that owns the memory."""

    def __init__(self, room: Room, give_back: Callable[[Room], None]) -> None:
        self._room, self._give_back = room, give_back
        self.__array_interface__ = room.__array_interface__

    def __del__(self) -> None:
        self._give_back(self._room)
