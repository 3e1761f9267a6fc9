"""The frame registry: the frames that were sent to any replica, and reports of the replicas."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from rhytid.engine.messages import DeviceInfo
from rhytid.fleet.frame_versions import ALL, Removals, Removed

# Seconds for which it is known that a replica was there.
PRESENT = 15.0
Positions = NDArray[np.float32]


@dataclass(frozen=True)
class Report:
    """The report of a replica of itself.

    pid: of its process.  device: on which it computes.  figures: the memory of its `Figures`.
    restarts: of the process of its device, by what had ended it.
    """

    replica: str
    pid: int
    device: DeviceInfo
    figures: bytes
    restarts: dict[str, int]


@dataclass(frozen=True)
class Stamp:
    """The version of a frame in one registry.

    life: of the registry that has it.  version: another for other positions, a later one is larger.
    """

    life: str
    version: int


@dataclass(frozen=True)
class News:
    """The removals that a replica has not heard of yet.

    life: another after the registry was started again: it has no frames then.  count: of removals,
    to ask with the next time.  removed: since the last time.  whole: whether these are all.
    """

    life: str
    count: int
    removed: Removed
    whole: bool


@dataclass(frozen=True)
class _Kept:
    version: int
    # None: it was removed.
    positions: Positions | None


class FrameRegistry:
    """Positions by asset and name, each with a version, and reports of replicas.

    A registry that was started again has none of them. Replicas give it what they have, each frame
    with its version: the latest is kept, and of what was removed nothing that is older. Versions
    grow with time and beyond those that were given.
    """

    def __init__(self) -> None:
        self._life = uuid4().hex
        self._used = self._version = 0
        self._frames: dict[str, dict[str, _Kept]] = {}
        self._removed = Removals()
        self._reports: dict[str, tuple[float, Report]] = {}

    async def keep(
        self, asset: str, name: str, positions: Positions, limit: int, after: int = 0
    ) -> Stamp:
        """Keep a frame that a replica has taken.

        limit: bytes of all positions; where there is no room the version is 0, and what was kept
        stays.  after: a version that the replica knows; the new one is larger.
        """
        if not self._has_room(asset, name, positions, limit):
            return Stamp(self._life, 0)
        version = self._next(after)
        self._put(asset, name, _Kept(version, np.array(positions, np.float32)))
        return Stamp(self._life, version)

    async def give(
        self, asset: str, name: str, version: int, positions: Positions, limit: int
    ) -> str:
        """Keep a frame that another registry had, unless a later one of its name is known; the life
        of this registry. Empty where there is no room."""
        self._version = max(self._version, version)
        if version > self._latest(asset, name):
            if not self._has_room(asset, name, positions, limit):
                return ""
            self._put(asset, name, _Kept(version, np.array(positions, np.float32)))
        return self._life

    async def missing(self, asset: str, versions: Mapping[str, int]) -> list[str]:
        """Names of those of these frames that this registry has, or knows as removed, only in an
        older version, or not at all."""
        return [name for name, version in versions.items() if version > self._latest(asset, name)]

    async def remove(self, asset: str, name: str, after: int = 0) -> int:
        """A frame was removed; the version of its absence, larger than `after`."""
        version = self._next(after)
        self._note_removal(asset, name, version)
        return version

    async def forget(self, asset: str, after: int = 0) -> int:
        """The asset is gone, and all of its frames; the version of that, larger than `after`."""
        return await self.remove(asset, ALL, after)

    async def remember(self, removed: Removed) -> None:
        """Take the removals that came before this registry was started."""
        for (asset, name), version in removed.items():
            self._version = max(self._version, version)
            if version > self._latest(asset, name):
                self._note_removal(asset, name, version)

    async def news(self, life: str, count: int) -> News:
        """The removals after the first `count` of a registry of that life."""
        removed, whole = self._removed.since(count if life == self._life else 0)
        return News(self._life, self._removed.count, removed, whole)

    async def versions(self, asset: str, names: Collection[str] | None = None) -> dict[str, int]:
        """Of the frames of an asset, and of those that were removed of late; of these names where
        they are given."""
        frames = self._frames.get(asset, {})
        asked = frames if names is None else [name for name in names if name in frames]
        return {name: frames[name].version for name in asked}

    async def frame(self, asset: str, name: str) -> tuple[Stamp, Positions | None]:
        """Stamp and (V, 3) positions of a frame; None of one that was removed, version 0 of one
        that is not known."""
        kept = self._frames.get(asset, {}).get(name, _Kept(0, None))
        return Stamp(self._life, kept.version), kept.positions

    async def report(self, report: Report) -> None:
        """Take the report of a replica, in place of its last one."""
        self._reports[report.replica] = (time.monotonic(), report)

    async def reports(self) -> list[Report]:
        """Of the replicas that are there, by their name."""
        since = time.monotonic() - PRESENT
        self._reports = {name: found for name, found in self._reports.items() if found[0] > since}
        return [found[1] for _, found in sorted(self._reports.items())]

    def _next(self, after: int) -> int:
        self._version = max(time.time_ns(), self._version + 1, after + 1)
        return self._version

    def _latest(self, asset: str, name: str) -> int:
        kept = self._frames.get(asset, {}).get(name)
        return max(0 if kept is None else kept.version, self._removed.version(asset, name))

    def _has_room(self, asset: str, name: str, positions: Positions, limit: int) -> bool:
        before = self._frames.get(asset, {}).get(name)
        return self._used + positions.nbytes - _nbytes(before) <= limit

    def _put(self, asset: str, name: str, kept: _Kept) -> None:
        self._drop(asset, name)
        self._removed.undo(asset, name)
        self._used += _nbytes(kept)
        self._frames.setdefault(asset, {})[name] = kept

    def _note_removal(self, asset: str, name: str, version: int) -> None:
        frames = self._frames.get(asset, {})
        for one in list(frames) if name == ALL else [name]:
            if one in frames and frames[one].version < version:
                self._drop(asset, one)
        if name != ALL:
            self._frames.setdefault(asset, {})[name] = _Kept(version, None)
        oldest = self._removed.note(asset, name, version)
        if oldest is not None and self._is_removed(*oldest):
            self._drop(*oldest)

    def _is_removed(self, asset: str, name: str) -> bool:
        kept = self._frames.get(asset, {}).get(name)
        return kept is not None and kept.positions is None

    def _drop(self, asset: str, name: str) -> None:
        frames = self._frames.get(asset, {})
        self._used -= _nbytes(frames.pop(name, None))
        if not frames:
            self._frames.pop(asset, None)


def _nbytes(kept: _Kept | None) -> int:
    return 0 if kept is None or kept.positions is None else kept.positions.nbytes
