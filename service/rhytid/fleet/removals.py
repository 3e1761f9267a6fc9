"""Which frames were removed last: a bounded number of them, so that names do not pile up."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping

# Removals that are known at a time. Replicas hear of each within seconds.
MOST = 4096
# In place of the name of a frame: the asset was removed, and all of its frames.
ALL = ""
# Versions by asset and name.
Removed = Mapping[tuple[str, str], int]


class Removals:
    """Versions of removals by asset and name; the oldest are forgotten first.

    most: that are known at a time.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        # Number and version of each, in the order of their numbers.
        self._known: OrderedDict[tuple[str, str], tuple[int, int]] = OrderedDict()
        self._forgotten = 0
        self.count = 0

    def __len__(self) -> int:
        return len(self._known)

    def note(self, asset: str, name: str, version: int) -> tuple[str, str] | None:
        """Note that a frame was removed, or with ALL every frame of an asset. Returns the oldest
        removal where that is forgotten for it, else None. Of two versions the later one stays."""
        _, known = self._known.get((asset, name), (0, 0))
        if known >= version:
            return None
        self.undo(asset, name)
        self.count += 1
        self._known[asset, name] = self.count, version
        if len(self._known) <= self._most:
            return None
        oldest, (self._forgotten, _) = self._known.popitem(last=False)
        return oldest

    def undo(self, asset: str, name: str) -> None:
        """The frame is there again."""
        self._known.pop((asset, name), None)

    def version(self, asset: str, name: str) -> int:
        """Of the removal of a frame, by itself or with its asset; 0 where none is known."""
        return max(self._known.get(key, (0, 0))[1] for key in ((asset, name), (asset, ALL)))

    def since(self, count: int) -> tuple[Removed, bool]:
        """Those that were noted after the first `count`, and whether none of them is forgotten."""
        found = {}
        for key, (number, version) in reversed(self._known.items()):
            if number <= count:
                break
            found[key] = version
        return found, count >= self._forgotten
