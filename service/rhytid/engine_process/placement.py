"""Which asset is on which device."""

from __future__ import annotations

import threading
from collections.abc import Sequence


class Placement:
    """The device of each asset; an asset stays where it was placed.

    limits: bytes that each device has. What assets take is their mesh and their wrinkles; maps and
    what is drawn are dropped where memory is short.
    """

    def __init__(self, limits: Sequence[int]) -> None:
        self._lock = threading.Lock()
        self._limits, self._room = [max(limit, 1) for limit in limits], list(limits)
        self._placed: dict[str, tuple[int, int]] = {}

    def place(self, asset: str, nbytes: int) -> tuple[int, bool]:
        """The device of an asset, and whether it is new: then it goes where most room is left, as a
        share of what the device has, so that equal ones take turns."""
        with self._lock:
            known = self._placed.get(asset)
            if known is not None:
                return known[0], False
            device = max(range(len(self._room)), key=self._free)
            self._placed[asset] = (device, nbytes)
            self._room[device] -= nbytes
            return device, True

    def _free(self, device: int) -> tuple[float, int, int]:
        room = self._room[device]
        return room / self._limits[device], room, -device

    def of(self, asset: str) -> int | None:
        """The device of an asset, if it has one."""
        found = self._placed.get(asset)
        return None if found is None else found[0]

    def forget(self, asset: str) -> None:
        """The asset is gone."""
        with self._lock:
            device, nbytes = self._placed.pop(asset, (0, 0))
            self._room[device] += nbytes

    def on(self, device: int) -> frozenset[str]:
        """The assets of a device."""
        with self._lock:
            return frozenset(asset for asset, (at, _) in self._placed.items() if at == device)
