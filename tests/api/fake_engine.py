"""An engine without a device: what the transport is tested over. Deterministic, numpy only."""

from __future__ import annotations

from typing import Any

from api.fake_assets import FakeAssets, FakeJobs
from api.fake_frames import FakeFrames
from api.fake_packages import FakePackages
from api.fake_snapshots import FakeSnapshots
from api.fake_state import FakeState
from api.fake_tiles import FakeTiles
from rhytid.device.figures import Figures
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.changes import Mark
from rhytid.engine.messages import (
    DeviceInfo,
)


class FakeEngine:
    """Builds take `polls` looks at their job; `drawn` lists what was computed."""

    def __init__(self, polls: int = 0) -> None:
        self.computes = self.lives = True
        self.figures = {"0": Figures()}
        self.memory = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
        self.state = FakeState(polls)
        self.assets, self.jobs = FakeAssets(self.state), FakeJobs(self.state)
        self.snapshots = FakeSnapshots(self.state)
        self.packages = FakePackages(self.state)
        self.frames, self.tiles = FakeFrames(self.state), FakeTiles(self.state)

    @property
    def drawn(self) -> list[tuple[Any, ...]]:
        return self.state.drawn

    def well(self) -> bool:
        return self.lives

    def ready(self) -> bool:
        return self.computes

    def mark(self, asset: str, frame: str) -> Mark | None:
        return None

    @property
    def waiting(self) -> int:
        return 3

    @property
    def restarts(self) -> dict[str, int]:
        return {"late": 2}

    def devices(self) -> list[DeviceInfo]:
        return [DeviceInfo("fake", "none", "CPU", "OpenCL 1.2", 2, 1 << 30, 1 << 29, 0, True)]
