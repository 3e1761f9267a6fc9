"""How often each caller may ask: a token bucket per caller, in bounded memory."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable

# Seconds that a caller may save up.
SAVED = 2.0
# Callers that are remembered; whoever asked longest ago is forgotten first, and has saved most.
REMEMBERED = 10_000


class Rates:
    """Counts requests by caller. For one thread.

    clock: seconds that only grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # What each had left, and when.
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str, rate: float) -> int:
        """0 where the caller may ask now; else in how many seconds it may, 1 at least.

        rate: requests per second; `SAVED` times as many may come at once.
        """
        now, most = self._clock(), max(SAVED * rate, 1.0)
        left, then = self._left.get(caller, (most, now))
        left = min(left + (now - then) * rate, most)
        allowed = left >= 1.0
        self._left[caller] = (left - allowed, now)
        self._left.move_to_end(caller)
        if len(self._left) > REMEMBERED:
            self._left.popitem(last=False)
        return 0 if allowed else math.ceil((1.0 - left) / rate)

    def __len__(self) -> int:
        return len(self._left)
