"""An engine that draws nothing: what baking is tested over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.messages import AssetInfo, FrameInfo, JobInfo, MapQuery

ASSET = AssetInfo(
    id="a" * 16,
    state="ready",
    job=None,
    reason=None,
    settings=AssetSettings.parse({"resolution": 256, "tile_size": 256}).as_json(),
    udims=(1001, 1002),
    levels=9,
    vertices=4,
    triangles=2,
    pores=2,
    wrinkles=1,
)
SIDE = 4


class FakeEngine:
    """Maps are full of a frame's first number; `drawn` lists them, `revision` is in every key."""

    def __init__(self) -> None:
        self.frames: dict[str, NDArray[Any]] = {}
        self.drawn: list[tuple[str, int]] = []
        self.calibrated: list[float] = []
        self.revision = 0
        self.failing_after: int | None = None
        self.calibration = JobInfo("c", ASSET.id, "calibration", "queued", 0.0, "", "")

    def put_frame(self, asset: str, frame: str, positions: Any) -> FrameInfo:
        assert asset == ASSET.id
        self.frames[frame] = positions
        return FrameInfo(frame, {"abs_p90": float(positions[0, 0])})

    def delete_frame(self, asset: str, frame: str) -> None:
        del self.frames[frame]

    def calibrate(self, asset: str, positions: Any) -> JobInfo:
        self.calibrated.append(float(positions[0, 0]))
        return self.calibration

    def job(self, job: str) -> JobInfo:
        self.calibration = replace(self.calibration, state="done", progress=1.0)
        return self.calibration

    def map_key(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> str:
        value = self.frames[frame][0, 0]
        about = f"{query.method}/{query.stretch}/{query.sampling}"
        return f"{self.revision}/{value}/{about}/{udim}/{level}"

    def map(
        self, asset: str, frame: str, query: MapQuery, udim: int, level: int
    ) -> NDArray[np.float32]:
        if self.failing_after is not None and len(self.drawn) == self.failing_after:
            raise KeyboardInterrupt
        self.drawn.append((frame, udim))
        return np.full((SIDE, SIDE), self.frames[frame][0, 0], np.float32)

    def displacement_scale(self, asset: str) -> float:
        return 1.0
