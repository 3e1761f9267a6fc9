"""How many work-items a launch has, so that none occupies the device for long."""

from __future__ import annotations

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
