"""An engine that draws nothing: what baking is tested over."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import MapAddress
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.job import Job
from rhytid.engine.messages import (
    AssetInfo,
    FrameInfo,
    JobInfo,
    MapPlan,
    MapQuery,
    TileDescription,
)
from rhytid.formats.tile_header import TileHeader
from rhytid.support.build_identity import drawing_version

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
    """Maps are full of a frame's first number; `drawn` lists them, `revision` and `version`, of
    the device and the drawing, are in every key."""

    def __init__(self) -> None:
        self.held: dict[str, NDArray[Any]] = {}
        self.drawn: list[tuple[str, int]] = []
        self.in_halves: list[tuple[str, int]] = []
        self.digests: list[str] = []
        self.calibrated: list[float] = []
        self.revision, self.version = 0, drawing_version()
        self.failing_after: int | None = None
        self.calibration = Job(JobInfo("c", ASSET.id, "calibration", "queued", 0.0, "", ""))
        self.assets, self.frames = FakeAssets(self), FakeFrames(self)
        self.tiles, self.jobs = FakeTiles(self), FakeJobs(self)
        self.memory = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")


@dataclass
class Part:
    """Some calls of an engine."""

    engine: FakeEngine


class FakeAssets(Part):
    def calibrate(self, asset: str, positions: Any) -> JobInfo:
        self.engine.calibrated.append(float(positions[0, 0]))
        return self.engine.calibration.info


class FakeFrames(Part):
    def put(self, asset: str, frame: str, positions: Any) -> FrameInfo:
        assert asset == ASSET.id
        self.engine.held[frame] = positions
        return FrameInfo(frame, {"abs_p90": float(positions[0, 0])})

    def digest(self, asset: str, frame: str) -> str:
        self.engine.digests.append(frame)
        return f"{float(self.engine.held[frame][0, 0]):032.3f}"

    def delete(self, asset: str, frame: str) -> None:
        del self.engine.held[frame]


class FakeJobs(Part):
    def get(self, job: str) -> Job:
        self.engine.calibration.update(state="done", progress=1.0)
        return self.engine.calibration


class FakeTiles(Part):
    @property
    def drawn_by(self) -> str:
        return f"device {self.engine.revision}/{self.engine.version}"

    def key(self, asset: str, frame: str, query: MapQuery, place: MapAddress, drawn_by: str) -> str:
        value, drawn = self.engine.held[frame][0, 0], (query.method, query.stretch, query.sampling)
        return f"{drawn_by}/{value}/{'/'.join(drawn)}/{place}"

    def memory_kept(self) -> AbstractContextManager[None]:
        return nullcontext()

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        return np.zeros((SIDE, SIDE), np.int32)

    def normal_codes(self, *about: object) -> NDArray[np.uint16]:
        return np.zeros((SIDE, SIDE, 3), np.uint16)

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> MapPlan:
        engine, value = self.engine, self.engine.held[frame][0, 0]
        drawn = (query.method, query.stretch, query.sampling)

        def draw() -> NDArray[np.float32]:
            if engine.failing_after is not None and len(engine.drawn) == engine.failing_after:
                raise KeyboardInterrupt
            engine.drawn.append((frame, udim))
            return np.full((SIDE, SIDE), value, np.float32)

        key = self.key(asset, frame, query, MapAddress(udim, level), self.drawn_by)
        header = TileHeader("cm", frame, asset, *drawn, udim, level, 0, 0, 1.0)

        def draw_halves() -> NDArray[np.float16]:
            engine.in_halves.append((frame, udim))
            return draw().astype(np.float16)

        return MapPlan(TileDescription(key, header, SIDE), draw, draw_halves)
