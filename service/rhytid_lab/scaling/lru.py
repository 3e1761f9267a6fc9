"""What a device holds: the heads that were used last."""

from __future__ import annotations

from collections import OrderedDict

from rhytid.errors import InputError


class Held:
    """At most `most` heads; the least recently used leaves first."""

    def __init__(self, most: int) -> None:
        if most < 1:
            raise InputError(f"a device holds {most} heads: at least 1")
        self._most = most
        self._heads: OrderedDict[int, None] = OrderedDict()

    def __contains__(self, head: int) -> bool:
        return head in self._heads

    def __len__(self) -> int:
        return len(self._heads)

    def use(self, head: int) -> bool:
        """Use a head; whether it was there. Where it was not it is loaded."""
        there = head in self._heads
        if there:
            self._heads.move_to_end(head)
        else:
            if len(self._heads) >= self._most:
                self._heads.popitem(last=False)
            self._heads[head] = None
        return there
