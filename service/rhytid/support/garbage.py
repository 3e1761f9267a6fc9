"""When a process that answers requests looks through all its objects for garbage: that holds up
all its threads, for 20 to 80 ms once libraries are imported, and a frame would wait for it."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable

# Seconds from one look at whether the process rests to the next.
_PAUSE = 30.0
# Seconds that such a look takes, and seconds of the processor that pass meanwhile at most.
_LOOK, _RESTING = 0.5, 0.01
# Seconds of the processor after which there may be garbage again.
_WORK = 1.0
# Where a process never rests, so many of Python's searches among younger objects from one among all
# to the next. Python itself takes 10.
_SEARCHES = 1000


class GarbageAtRest:
    """Looks for garbage among all objects while the process rests, and else hardly ever."""

    def __init__(self) -> None:
        gc.set_threshold(*gc.get_threshold()[:2], _SEARCHES)
        self._searched = time.process_time()

    def search(self, end: threading.Event) -> bool:
        """Look for garbage, unless the process works or has done little since the last time;
        returns whether it did. Takes no longer once `end` is set."""
        before = time.process_time()
        if before - self._searched < _WORK or end.wait(_LOOK):
            return False
        if time.process_time() - before > _RESTING:
            return False
        gc.unfreeze()
        gc.collect()
        gc.freeze()  # what is left is not looked at again until the process rests again
        self._searched = time.process_time()
        return True


def tidy_at_rest(end: threading.Event, also: Callable[[], None] | None = None) -> None:
    """Begin to look for garbage as GarbageAtRest does, every so often, on a thread of its own until
    `end` is set.  also: called every time."""
    garbage = GarbageAtRest()

    def work() -> None:
        while not end.wait(_PAUSE):
            garbage.search(end)
            if also is not None:
                also()

    threading.Thread(target=work, name="rhytid-memory", daemon=True).start()
