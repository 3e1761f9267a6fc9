"""The assets that an engine knows, and the state that each is in."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.frame_warnings import FrameCheck
from rhytid.domain.lengths import Lengths
from rhytid.domain.notices import grain_notice
from rhytid.domain.origin import ORIGIN, Centre
from rhytid.domain.tiles import TileAddress
from rhytid.domain.warnings import InputWarning
from rhytid.engine.frames import Frame, FrameMemory, Frames
from rhytid.engine.jobs import Job
from rhytid.engine.messages import AssetInfo
from rhytid.engine.resident_levels import ResidentLevels
from rhytid.errors import ConflictError, NotFoundError, NotReadyError


@dataclass(eq=False)
class Asset:
    """One asset: its facts on the host, its frames, and what is on the device once it is ready."""

    id: str
    settings: AssetSettings
    vertices: int
    triangles: int
    udims: tuple[int, ...]
    frames: Frames
    job: Job | None = None
    state: str = "building"
    reason: str | None = None
    pores: int = 0
    wrinkles: int = 0
    # What settings are resolved with.
    lengths: Lengths = field(default_factory=lambda: Lengths.of(1.0))
    # Mean distance of neighbouring pores on the surface, in mesh units, once it is known.
    distance: float | None = None
    statistics: dict[str, Any] | None = None
    resident: ResidentLevels | None = None
    warnings: tuple[InputWarning, ...] = ()
    centre: Centre = field(default_factory=lambda: ORIGIN)
    # Mesh units that a step of 1 in UV is long.
    uv_length: float = 0.0
    # None of an asset that is known as failed alone.
    frame_check: FrameCheck | None = None
    # Held while settings change, so that no two changes are lost in one another.
    changing: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def failed(cls, id: str, reason: str, memory: FrameMemory) -> Asset:
        """An asset of which only the name is left, and why."""
        asset = cls(id, AssetSettings(), 0, 0, (), Frames(memory))
        asset.state, asset.reason = "failed", reason
        return asset

    def info(self) -> AssetInfo:
        """As a caller sees it."""
        return AssetInfo(
            id=self.id,
            state=self.state,
            job=self.job.info.id if self.job else None,
            reason=self.reason,
            settings=self.settings.as_json(),
            udims=self.udims,
            levels=self.settings.grid.levels,
            vertices=self.vertices,
            triangles=self.triangles,
            pores=self.pores,
            wrinkles=self.wrinkles,
            statistics=self.statistics,
            warnings=self.warnings,
            notices=grain_notice(self.settings, self.uv_length),
            centre=tuple(self.centre.tolist()),
        )

    def ready(self) -> ResidentLevels:
        """What is on the device; raises NotReadyError while building, ConflictError if failed."""
        if self.state == "building":
            raise NotReadyError(f"asset {self.id} is still building")
        if self.resident is None:
            raise ConflictError(f"asset {self.id} failed to build: {self.reason}")
        return self.resident

    def frame(self, name: str) -> Frame:
        """A stored frame; raises NotFoundError, and what `ready` raises."""
        self.ready()
        return self.frames.get(name)

    def frame_warnings(self, positions: NDArray[np.float32], name: str) -> tuple[InputWarning, ...]:
        """What is probably wrong with positions (V, 3) that are called `name`."""
        if self.frame_check is None:
            return ()
        return self.frame_check.warnings(positions, name)

    def check_udim(self, udim: int) -> None:
        """Raise NotFoundError for a UDIM without mesh."""
        if udim not in self.udims:
            have = ", ".join(str(u) for u in self.udims) or "none"
            raise NotFoundError(f"UDIM {udim} has no mesh; asset {self.id} has {have}")

    def check_address(self, address: TileAddress) -> None:
        """Raise NotFoundError where the tile does not exist, and what `ready` raises."""
        self.ready()
        self.check_udim(address.udim)
        self.settings.grid.check(address)


class Assets:
    """Assets by id."""

    def __init__(self, frame_memory: int) -> None:
        self.frame_memory = FrameMemory(frame_memory)
        # Held while assets come and go in the store; looking one up never waits for the disk.
        self.changing = threading.RLock()
        self._lock = threading.Lock()
        self._assets: dict[str, Asset] = {}

    def find(self, id: str) -> Asset | None:
        """The asset of that id, if there is one."""
        with self._lock:
            return self._assets.get(id)

    def get(self, id: str) -> Asset:
        """The asset of that id; raises NotFoundError."""
        found = self.find(id)
        if found is None:
            raise NotFoundError(f"no asset {id!r}")
        return found

    def all(self) -> list[Asset]:
        """Every asset, in the order in which they came."""
        with self._lock:
            return list(self._assets.values())

    def add(self, asset: Asset) -> None:
        """Know an asset, in place of one of the same id."""
        with self._lock:
            self._assets[asset.id] = asset

    def remove(self, id: str) -> Asset:
        """Forget an asset; raises NotFoundError."""
        found = self.get(id)
        with self._lock:
            self._assets.pop(id, None)
        return found

    def knows(self, asset: Asset) -> bool:
        """Whether it is this very asset that its id stands for: not removed, not made anew."""
        return self.find(asset.id) is asset
