"""What an ingress knows of frames: the versions of those that came through it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any

from rhytid.engine_process.frame_ledger import FrameLedger
from rhytid.fleet.removals import Removals

_REMEMBERED = 100_000


class FrameVersions(FrameLedger):
    """A ledger that keeps no positions: the board does."""

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
