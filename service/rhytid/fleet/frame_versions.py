"""What an ingress knows of frames: the versions of those that came through it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any

from rhytid.engine_process.frame_ledger import FrameLedger

_REMEMBERED = 100_000


class FrameVersions(FrameLedger):
    """A ledger that keeps no positions: the board does."""

    def __init__(self) -> None:
        super().__init__(0, _never)
        self._versions: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._noting = threading.Lock()

    def note(self, asset: str, name: str, version: int) -> None:
        """A frame has this version now, or a later one."""
        with self._noting:
            known = self._versions.pop((asset, name), 0)
            self._versions[asset, name] = max(known, version)
            while len(self._versions) > _REMEMBERED:
                self._versions.popitem(last=False)

    def version(self, asset: str, name: str) -> int:
        """The version that there is at least; 0 of a frame that did not come through here."""
        return self._versions.get((asset, name), 0)


def _never(*arguments: Any) -> None:
    raise AssertionError("positions are not kept here")
