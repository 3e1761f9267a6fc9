"""What the parts of the fake engine share: its assets and its jobs."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.frame import NEUTRAL
from rhytid.domain.tiles import TileAddress, mesh_udims
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.messages import (
    JobInfo,
    NewAsset,
)
from rhytid.errors import NotFoundError, NotReadyError


@dataclass
class FakeAsset:
    """What the fake keeps of an asset."""

    new: NewAsset
    settings: AssetSettings
    job: str
    frames: dict[str, NDArray[np.float32]] = field(default_factory=dict)


class FakeState:
    """Builds take `polls` looks at their job; `drawn` lists what was computed."""

    def __init__(self, polls: int) -> None:
        self.polls = polls
        self.drawn: list[tuple[Any, ...]] = []
        self.assets: dict[str, FakeAsset] = {}
        self.jobs: dict[str, JobInfo] = {}

    def job(self, id: str) -> JobInfo:
        if id not in self.jobs:
            raise NotFoundError(f"no job {id!r}")
        info = self.jobs[id]
        if info.state in ("queued", "running"):
            self.jobs[id] = self._advanced(info)
        return self.jobs[id]

    def start(self, asset: str, kind: str) -> str:
        name = f"{kind}-{asset}-{len(self.jobs)}"
        state, progress = ("queued", 0.0) if self.polls else ("done", 1.0)
        self.jobs[name] = JobInfo(name, asset, kind, state, progress, "trails", "")
        return name

    def _advanced(self, info: JobInfo) -> JobInfo:
        progress = info.progress + 1 / self.polls
        state = "running" if progress < 1 - 1e-9 else "done"
        return replace(info, state=state, progress=min(progress, 1.0))

    def doubts(self, positions: Any, where: str) -> tuple[InputWarning, ...]:
        """Something is doubtful above 50."""
        large = float(np.max(positions)) > 50.0
        return (InputWarning("mesh-size", "täglich größer", where),) if large else ()

    def positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        found = self.built(asset)
        if frame == NEUTRAL:
            return found.new.mesh.positions
        if frame not in found.frames:
            raise NotFoundError(f"asset {asset} has no frame {frame!r}")
        return found.frames[frame]

    def moved(self, asset: str, positions: Any) -> float:
        return float(np.abs(positions - self.find(asset).new.mesh.positions).max())

    def find(self, asset: str) -> FakeAsset:
        if asset not in self.assets:
            raise NotFoundError(f"no asset {asset!r}")
        return self.assets[asset]

    def built(self, asset: str) -> FakeAsset:
        found = self.find(asset)
        if self.jobs[found.job].state != "done":
            raise NotReadyError(f"asset {asset} is still building")
        return found

    def check(self, asset: str, address: TileAddress) -> FakeAsset:
        found = self.built(asset)
        if address.udim not in mesh_udims(found.new.mesh):
            raise NotFoundError(f"asset {asset} has no UDIM {address.udim}")
        found.settings.grid.check(address)
        return found

    def judged(
        self, positions: Any, where: str, strict: bool, allow: Collection[str]
    ) -> tuple[InputWarning, ...]:
        check_codes(allow)
        found = self.doubts(positions, where)
        if strict:
            refuse(found, allow)
        return found


@dataclass
class Part:
    """Some calls of the fake engine."""

    state: FakeState


def digest_of(text: str, *arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256(text.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
