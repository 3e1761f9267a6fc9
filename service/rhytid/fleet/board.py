"""What all replicas and ingresses know in common: the frames that were sent, and who is there."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rhytid.engine.messages import DeviceInfo

# Seconds for which it is known that a frame was removed, and that a replica was there.
REMEMBERED, PRESENT = 600.0, 15.0
Positions = NDArray[np.float32]


@dataclass(frozen=True)
class Report:
    """What a replica says of itself.

    pid: of its process.  device: on which it computes.  figures: the memory of its `Figures`.
    restarts: of the process of its device, by what had ended it.
    """

    replica: str
    pid: int
    device: DeviceInfo
    figures: bytes
    restarts: dict[str, int]


@dataclass
class _Kept:
    version: int
    positions: Positions | None
    at: float = field(default_factory=time.monotonic)


class Board:
    """Positions by asset and name, each with a version, and reports of replicas.

    limit: bytes of positions; frames beyond them are refused. Versions grow with time, so that a
    board that was started again goes on with larger ones.
    """

    def __init__(self, limit: int) -> None:
        self._limit, self._used, self._version = limit, 0, 0
        self._frames: dict[str, dict[str, _Kept]] = {}
        self._reports: dict[str, tuple[float, Report]] = {}

    async def keep(self, asset: str, name: str, positions: Positions) -> int:
        """Keep a frame that a replica has taken; its version. 0 where there is no room for it: what
        was kept stays."""
        before = self._frames.get(asset, {}).get(name)
        if self._used + positions.nbytes - _nbytes(before) > self._limit:
            return 0
        self._drop(asset, name)
        kept = _Kept(self._next(), np.array(positions, np.float32))
        self._used += positions.nbytes
        self._frames.setdefault(asset, {})[name] = kept
        return kept.version

    async def remove(self, asset: str, name: str) -> int:
        """A frame was removed; the version of its absence."""
        self._drop(asset, name)
        frames = self._frames.setdefault(asset, {})
        before = time.monotonic() - REMEMBERED
        for old in [n for n, k in frames.items() if k.positions is None and k.at < before]:
            del frames[old]
        frames[name] = _Kept(self._next(), None)
        return frames[name].version

    async def forget(self, asset: str) -> None:
        """The asset is gone, and all of its frames."""
        for name in list(self._frames.get(asset, ())):
            self._drop(asset, name)
        self._frames.pop(asset, None)

    async def versions(self, asset: str) -> dict[str, int]:
        """Of the frames of an asset, and of those that were removed a while ago."""
        return {name: kept.version for name, kept in self._frames.get(asset, {}).items()}

    async def frame(self, asset: str, name: str) -> tuple[int, Positions | None]:
        """Version and (V, 3) positions of a frame; None of one that was removed, version 0 of one
        that is not known."""
        kept = self._frames.get(asset, {}).get(name)
        return (0, None) if kept is None else (kept.version, kept.positions)

    async def report(self, report: Report) -> None:
        """What a replica says of itself, in place of what it said before."""
        self._reports[report.replica] = (time.monotonic(), report)

    async def reports(self) -> list[Report]:
        """Of the replicas that are there, by their name."""
        since = time.monotonic() - PRESENT
        self._reports = {name: found for name, found in self._reports.items() if found[0] > since}
        return [found[1] for _, found in sorted(self._reports.items())]

    def _next(self) -> int:
        self._version = max(time.time_ns(), self._version + 1)
        return self._version

    def _drop(self, asset: str, name: str) -> None:
        self._used -= _nbytes(self._frames.get(asset, {}).pop(name, None))


def _nbytes(kept: _Kept | None) -> int:
    return 0 if kept is None or kept.positions is None else kept.positions.nbytes
