"""How many work-items a launch has, so that none occupies the device for long."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

# Work-items of a launch: the most, the least, and of a kernel that nobody has measured yet.
MOST, LEAST, FIRST = 1 << 18, 1 << 10, 1 << 12
# What a launch should take. Its items may be several times as much work as those before.
SECONDS = 0.025
# From one launch to the next no more times as many: the first is slow while its kernel is compiled.
_GROWTH = 8


class Paces:
    """Work-items of each kernel that take about SECONDS, by how long its launch before took."""

    def __init__(self) -> None:
        self._items: dict[tuple[str, str], int] = {}

    def items(self, program: str, kernel: str) -> int:
        """How many a launch should have: a power of two."""
        return self._items.get((program, kernel), FIRST)

    def took(self, program: str, kernel: str, items: int, seconds: float) -> None:
        """A launch of so many took so long."""
        planned = self.items(program, kernel)
        if items < planned and seconds < SECONDS:
            return  # the end of a run: too few work-items to predict the time of more
        wanted = int(items * SECONDS / max(seconds, 1e-6))
        most = min(MOST, planned * _GROWTH)
        size = 1 << max(min(wanted, most).bit_length() - 1, 0)
        self._items[program, kernel] = max(size, LEAST)


# What one launch, or one piece, of drawing should take.
DRAWING = 0.05
# Work a second (see pipeline/work.py) that is taken for granted until something was measured: what
# a processor with two cores does while it is busy with other things, too.
FIRST_WORK = 5e8
# A pace is lowered where a piece takes so many times as long as it should, raised where the pace is
# so many times as high, and else left, so that pieces stay the same from one frame to the next.
_OFF = 2.0
# By no more than this at once: a kernel may be compiled first, or the machine have been busy.
_STEP = 4.0


class WorkPace:
    """Work a second, by how long pieces took."""

    def __init__(self, per_second: float) -> None:
        self.per_second = per_second

    @property
    def most(self) -> float:
        """Work that takes about DRAWING seconds."""
        return DRAWING * self.per_second

    @contextmanager
    def timing(self, work: float) -> Iterator[None]:
        """The block does so much work, and waits until it is done."""
        start = time.perf_counter()
        yield
        self.took(work, time.perf_counter() - start)

    def took(self, work: float, seconds: float) -> None:
        """So much work took so long."""
        found = work / max(seconds, 1e-6)
        if seconds > _OFF * DRAWING and found < self.per_second:
            self.per_second = max(found, self.per_second / _STEP)
        elif found > _OFF * self.per_second:
            self.per_second *= _OFF
