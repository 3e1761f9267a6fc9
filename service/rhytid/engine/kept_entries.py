"""Arrays computed from one asset on the device, which can be computed again, under the memory
budget."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from rhytid.device.budget import MemoryBudget, Releasable
from rhytid.engine.frames import Frame
from rhytid.errors import NotFoundError

T = TypeVar("T", bound=Releasable)
# Frames of an asset whose stretch, and what follows from it, stay on the device. A task uses two at
# most, its frame and the neutral, so none is dropped in the task that uses it.
RECENT_FRAMES = 8


class KeptEntries:
    """Entries of the memory budget that belong to one asset. What belongs to a frame is kept for
    the frames used last, what belongs to a tile until memory is short. Every method runs in a
    task of the device.
    """

    def __init__(self, budget: MemoryBudget) -> None:
        self._budget = budget
        self._recent: OrderedDict[str, None] = OrderedDict()
        self.released = False

    def keep(self, *key: Hashable, make: Callable[[], T]) -> T:
        """The entry of a key, made if there is none. Raises NotFoundError after `release`."""
        if self.released:
            raise NotFoundError("the asset was removed")
        return self._budget.keep((id(self), *key), make)

    def keep_of(self, frame: Frame, *key: Hashable, make: Callable[[], T]) -> T:
        """As `keep`, for one of the frames used last. A new frame reuses the memory of the least
        recently used one: fresh memory costs more time than drawing."""
        self._recent[frame.digest] = None
        self._recent.move_to_end(frame.digest)
        if len(self._recent) > RECENT_FRAMES:
            old, _ = self._recent.popitem(last=False)
            self._drop(lambda kept: kept[-1] == old)
        return self.keep(*key, frame.digest, make=make)

    def find(self, *key: Hashable) -> Any | None:
        """What is kept under a key, or None."""
        return self._budget.find((id(self), *key))

    def find_of(self, frame: Frame, *key: Hashable) -> Any | None:
        """What is kept of a frame under a key, or None."""
        if frame.digest in self._recent:
            self._recent.move_to_end(frame.digest)
        return self.find(*key, frame.digest)

    def discard(self, *key: Hashable) -> None:
        """Release what is kept under a key."""
        self._budget.discard((id(self), *key))

    def clear(self) -> None:
        """Release all that is kept."""
        self._recent.clear()
        self._drop(lambda kept: True)

    def release(self) -> None:
        """As `clear`; from then on nothing is kept."""
        self.clear()
        self.released = True

    def _drop(self, belongs: Callable[[tuple[Hashable, ...]], bool]) -> None:
        def of_this(key: Hashable) -> bool:
            return isinstance(key, tuple) and key[0] == id(self) and belongs(key)

        self._budget.drop(of_this)
