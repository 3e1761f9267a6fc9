"""Versions of frames: what an ingress knows, and which frames were removed last."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from rhytid.processes.frame_ledger import FrameLedger

_REMEMBERED = 100_000
# Removals that are known at a time. Replicas hear of each within seconds.
MOST = 4096
# In place of the name of a frame: the asset was removed, and all of its frames.
ALL = ""
# Versions by asset and name.
Removed = Mapping[tuple[str, str], int]


class FrameVersions(FrameLedger):
    """A ledger that keeps no positions: the registry does."""

    def __init__(self) -> None:
        super().__init__(0, _never)
        self._versions: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._gone = Removals()
        self._noting = threading.Lock()

    def __len__(self) -> int:
        return len(self._versions) + len(self._gone)

    def note(self, asset: str, name: str, version: int, *, removed: bool = False) -> None:
        """A frame has this version now, or a later one.  removed: it is that of its absence."""
        with self._noting:
            if version < self.version(asset, name):
                return
            self._versions.pop((asset, name), None)
            if removed:
                self._gone.note(asset, name, version)
                return
            self._gone.undo(asset, name)
            self._versions[asset, name] = version
            while len(self._versions) > _REMEMBERED:
                self._versions.popitem(last=False)

    def forget(self, asset: str, name: str | None = None) -> None:
        """The asset is gone, and all of its frames. Of a single frame that is removed the version
        stays known: replicas that have it still look for a later one."""
        if name is None:
            with self._noting:
                for key in [key for key in self._versions if key[0] == asset]:
                    del self._versions[key]

    def version(self, asset: str, name: str) -> int:
        """The version that there is at least; 0 of a frame that did not come through here."""
        return self._versions.get((asset, name)) or self._gone.version(asset, name)


def _never(*arguments: Any) -> None:
    raise AssertionError("positions are not kept here")


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
