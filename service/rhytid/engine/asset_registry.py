"""The registered assets by id."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rhytid.engine.assets import Asset
from rhytid.engine.frames import FrameMemory
from rhytid.errors import NotFoundError


class AssetRegistry:
    """Assets by id. Looking one up never waits for a device or a disk.

    elsewhere: brings the asset of an id that is not registered, or raises NotFoundError.
    """

    def __init__(self, frame_memory: int) -> None:
        self.frame_memory = FrameMemory(frame_memory)
        self.elsewhere: Callable[[str], Asset] = _nowhere
        self._lock = threading.Lock()
        self._assets: dict[str, Asset] = {}

    def find(self, id: str) -> Asset | None:
        """The asset of that id, if there is one."""
        with self._lock:
            return self._assets.get(id)

    def get(self, id: str) -> Asset:
        """The asset of that id, which may be brought from elsewhere; raises NotFoundError, and
        FetchingError while it is brought."""
        found = self.find(id) or self.elsewhere(id)
        found.used = time.monotonic()
        return found

    def all(self) -> list[Asset]:
        """Every asset, in the order in which they came."""
        with self._lock:
            return list(self._assets.values())

    def replace(self, old: Asset | None, new: Asset | None) -> bool:
        """Register `new` in place of `old`, each of which may be None. Returns False, and changes
        nothing, if `old` is not what is registered now."""
        id = (new or old).id  # type: ignore[union-attr]
        with self._lock:
            if self._assets.get(id) is not old:
                return False
            if new is None:
                self._assets.pop(id, None)
            else:
                self._assets[id] = new
        return True


def _nowhere(id: str) -> Asset:
    raise NotFoundError(f"no asset {id!r}")
