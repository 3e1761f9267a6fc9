"""An engine without a device: what the transport is tested over. Deterministic, numpy only."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace as Namespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.curves import Curves
from rhytid.domain.frame import NEUTRAL, check_frame_name, check_positions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress, mesh_udims
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.messages import (
    AssetContent,
    AssetInfo,
    BinManifest,
    CushionLayer,
    DeviceInfo,
    FrameInfo,
    FrameStretch,
    GrainLayer,
    JobInfo,
    MapQuery,
    NewAsset,
)
from rhytid.engine.tile_service import TilePlan, of_map
from rhytid.errors import NotFoundError, NotReadyError, ReadOnlyError, SettingsError
from rhytid.formats.tile_header import TileHeader

GRAPH = WrinkleGraph(
    node_uv=[[0.25, 0.25], [0.75, 0.5]],
    node_weight=[1.0, 0.5],
    node_radius=[0.01, 0.01],
    edge_nodes=[[0, 1]],
    edge_weight=[1.0],
    edge_half_width=[0.02],
)
CURVES = Curves(
    points=np.array([[0, 0, 0], [1, 2, 3], [0.5, -0.25, 1e-7]], np.float32),
    lines=np.array([[0, 1], [2, 0]]),
    widths=np.array([0.5, 0.25], np.float32),
    strengths=np.array([1.0, 0.125], np.float32),
)
PERCENTILES = ("p1", "p10", "p50", "p90", "p99", "abs_p90")


@dataclass
class FakeAsset:
    """What the fake keeps of an asset."""

    new: NewAsset
    settings: AssetSettings
    job: str
    frames: dict[str, NDArray[np.float32]] = field(default_factory=dict)


class FakeEngine:
    """Builds take `polls` looks at their job; `drawn` lists what was computed.

    Heights are a ripple over the whole map, scaled by how far the frame is from the neutral.
    """

    def __init__(self, polls: int = 0) -> None:
        self.polls = polls
        self.drawn: list[tuple[Any, ...]] = []
        self.computes = True
        self.memory = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
        self._assets: dict[str, FakeAsset] = {}
        self._jobs: dict[str, JobInfo] = {}
        self.assets = Namespace(
            create=self.create_asset, all=self.all_assets, info=self.asset_info,
            change=self.change_asset, delete=self.delete_asset, graph=self.graph,
            curves=self.curves, mesh=self.mesh, content=self.content, calibrate=self.calibrate,
        )  # fmt: skip
        self.frames = Namespace(
            put=self.put_frame, warnings=self.frame_warnings, all=self.all_frames,
            info=self.frame_info, positions=self.frame_positions, delete=self.delete_frame,
            stretch=self.stretch,
        )  # fmt: skip
        self.tiles = Namespace(
            plan=self.plan, plan_map=self.plan_map, plans_once=self.plans_once, bins=self.bins,
            bin_tile=self.bin_tile,
        )  # fmt: skip
        self.jobs = Namespace(info=self.job, cancel=self.cancel_job)

    def ready(self) -> bool:
        return self.computes

    @property
    def waiting(self) -> int:
        return 3

    def devices(self) -> list[DeviceInfo]:
        return [DeviceInfo("fake", "none", "CPU", "OpenCL 1.2", 2, 1 << 30, 1 << 29, 0, True)]

    # Assets and jobs

    def create_asset(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        check_codes(allow)
        if strict:
            refuse(self._doubts(new.mesh.positions, "mesh"), allow)
        arrays = [new.mesh.positions, new.mesh.faces, new.mesh.uv, new.mesh.face_uv]
        name = _digest(repr(new.settings), *arrays)[:16]
        if name not in self._assets:
            job = self._start(name, "build")
            self._assets[name] = FakeAsset(new, new.settings.resolved(0.01), job)
            for i, frame in enumerate(() if new.frames is None else new.frames):
                self._assets[name].frames[f"{i:04d}"] = frame
        return self.asset_info(name)

    def all_assets(self) -> list[AssetInfo]:
        return [self.asset_info(name) for name in self._assets]

    def asset_info(self, asset: str) -> AssetInfo:
        found = self._find(asset)
        mesh, job = found.new.mesh, self._jobs[found.job]
        graph = found.new.graph or GRAPH
        built = job.state == "done"
        return AssetInfo(
            id=asset,
            state={"done": "ready", "cancelled": "failed"}.get(job.state, "building"),
            job=found.job,
            reason="the build was cancelled" if job.state == "cancelled" else None,
            settings=found.settings.as_json(),
            udims=mesh_udims(mesh),
            levels=found.settings.grid.levels,
            vertices=len(mesh.positions),
            triangles=len(mesh.faces),
            pores=graph.pores if built else 0,
            wrinkles=graph.wrinkles if built else 0,
            statistics={"spacing": 0.01, **graph.figures()} if built else None,
            warnings=self._doubts(mesh.positions, "mesh"),
            centre=tuple(mesh.centre.tolist()),
        )

    def change_asset(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        found = self._built(asset)
        for key in ("resolution", "graph"):
            if key in changes:
                raise SettingsError(f"{key} cannot be changed: send a new asset")
        found.settings = found.settings.changed(changes)
        return self.asset_info(asset)

    def delete_asset(self, asset: str) -> None:
        del self._jobs[self._find(asset).job]
        del self._assets[asset]

    def graph(self, asset: str) -> WrinkleGraph:
        return self._built(asset).new.graph or GRAPH

    def content(self, asset: str) -> AssetContent:
        return AssetContent(_digest(repr((asset, self._built(asset).settings))), 1 << 10)

    def mesh(self, asset: str) -> Mesh:
        return self._built(asset).new.mesh

    def curves(self, asset: str) -> Curves:
        self._built(asset)
        return CURVES

    def job(self, id: str) -> JobInfo:
        if id not in self._jobs:
            raise NotFoundError(f"no job {id!r}")
        info = self._jobs[id]
        if info.state in ("queued", "running"):
            self._jobs[id] = self._advanced(info)
        return self._jobs[id]

    def cancel_job(self, id: str) -> JobInfo:
        info = self.job(id)
        if info.state != "done":
            self._jobs[id] = replace(info, state="cancelled", detail="by the caller")
        return self._jobs[id]

    def _start(self, asset: str, kind: str) -> str:
        name = f"{kind}-{asset}-{len(self._jobs)}"
        state, progress = ("queued", 0.0) if self.polls else ("done", 1.0)
        self._jobs[name] = JobInfo(name, asset, kind, state, progress, "trails", "")
        return name

    def _advanced(self, info: JobInfo) -> JobInfo:
        progress = info.progress + 1 / self.polls
        state = "running" if progress < 1 - 1e-9 else "done"
        return replace(info, state=state, progress=min(progress, 1.0))

    # Frames

    def put_frame(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        found = self._built(asset)
        self.frame_warnings(asset, positions, strict=strict, allow=allow)
        if check_frame_name(frame) == NEUTRAL:
            raise ReadOnlyError("frame 'neutral' cannot be written")
        found.frames[frame] = check_positions(positions, len(found.new.mesh.positions))
        return self.frame_info(asset, frame)

    def all_frames(self, asset: str) -> list[FrameInfo]:
        return [self.frame_info(asset, name) for name in (NEUTRAL, *self._built(asset).frames)]

    def frame_info(self, asset: str, frame: str) -> FrameInfo:
        positions = self.frame_positions(asset, frame)
        moved = self._moved(asset, positions)
        doubts = self._doubts(positions, f"frame {frame}") if frame != NEUTRAL else ()
        return FrameInfo(frame, dict.fromkeys(PERCENTILES, moved), doubts)

    def frame_warnings(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        check_codes(allow)
        found = self._doubts(positions, "the positions")
        if strict:
            refuse(found, allow)
        return found

    def _doubts(self, positions: Any, where: str) -> tuple[InputWarning, ...]:
        """Something is doubtful above 50."""
        large = float(np.max(positions)) > 50.0
        return (InputWarning("mesh-size", "täglich größer", where),) if large else ()

    def frame_positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        found = self._built(asset)
        if frame == NEUTRAL:
            return found.new.mesh.positions
        if frame not in found.frames:
            raise NotFoundError(f"asset {asset} has no frame {frame!r}")
        return found.frames[frame]

    def delete_frame(self, asset: str, frame: str) -> None:
        self.frame_positions(asset, frame)
        if frame == NEUTRAL:
            raise ReadOnlyError("frame 'neutral' cannot be deleted")
        del self._find(asset).frames[frame]

    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        found = self._built(asset)
        warnings = self.frame_warnings(asset, positions, strict=strict, allow=allow)
        check_positions(positions, len(found.new.mesh.positions))
        found.settings = found.settings.with_r_max(0.3)
        name = self._start(asset, "calibrate")
        self._jobs[name] = replace(self._jobs[name], warnings=warnings)
        return self._jobs[name]

    # Maps

    def tile_key(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> str:
        found = self._check(asset, address)
        positions = self.frame_positions(asset, frame)
        return _digest(repr((asset, found.settings, query, address)), positions)

    def tile(
        self, asset: str, frame: str, query: MapQuery, address: TileAddress
    ) -> NDArray[np.float32]:
        self.tile_key(asset, frame, query, address)
        return self._draw(asset, self.frame_positions(asset, frame), query, address)

    def map_key(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> str:
        return "map" + self.tile_key(asset, frame, query, TileAddress(udim, level, 0, 0))

    def map(
        self, asset: str, frame: str, query: MapQuery, udim: int, level: int
    ) -> NDArray[np.float32]:
        self.map_key(asset, frame, query, udim, level)
        self.drawn.append((udim, level, query.method))
        return self._ripple(asset, self.frame_positions(asset, frame), level)

    def stretch(self, asset: str, frame: str) -> FrameStretch:
        self.frame_positions(asset, frame)
        count = len(self._built(asset).new.mesh.faces)
        axes = np.broadcast_to(np.eye(2, dtype=np.float32), (count, 2, 2))
        return FrameStretch(axes, np.ones((count, 2), np.float32))

    def plan(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> TilePlan:
        key = self.tile_key(asset, frame, query, address)
        draw = partial(self.tile, asset, frame, query, address)
        side = self._find(asset).settings.grid.texels(address.level)
        return TilePlan(key, self._header(asset, frame, query, address), side, draw)

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> TilePlan:
        key = self.map_key(asset, frame, query, udim, level)
        draw = partial(self.map, asset, frame, query, udim, level)
        header = self._header(asset, frame, query, TileAddress(udim, level, 0, 0))
        return TilePlan(key, header, self._find(asset).settings.grid.side(level), draw)

    def _header(self, asset: str, frame: str, query: MapQuery, at: TileAddress) -> TileHeader:
        settings = self._built(asset).settings
        drawn = (query.method, query.stretch, query.sampling)
        place = (at.udim, at.level, at.row, at.column)
        return TileHeader(settings.unit, frame, asset, *drawn, *place, 4.5 * (settings.depth or 0))

    def bins(self, asset: str) -> BinManifest:
        bins = self._built(asset).settings.bins
        angles = tuple(float(a) for a in np.pi * np.arange(bins.count) / bins.count)
        samples = (-bins.r_max, 0.0, bins.r_max)
        layers = {"wrinkles": bins.count, "pores": 1}
        if bins.merge == "mellow":
            layers |= {"wrinkle_bulges": bins.count, "pore_bulges": 1}
        layers["grain"] = 1
        steps = {**dict.fromkeys(layers, (1e-4,) * 3), "grain": (1e-4,)}
        factored = bins.depth_factored
        return BinManifest(
            angles, samples, steps, bins.bits, bins.merge, factored, layers, samples,
            depth=1.0, sharpness=20.0, log_stretch_limit=0.5, scale_limit=4.0,
            depth_exponents={"wrinkles": 4.0, "pores": 10.0}, measured_in="uv", tilt=None,
            soft_limits=True, pore_depth_limit=2.0,
            cushion=CushionLayer(4, 2, 5.0), grain=GrainLayer(2.0),
        )  # fmt: skip

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        found, manifest = self._check(asset, address), self.bins(asset)
        bin, sample = of_map(manifest, layer, bin, sample)
        if address.level > 0:
            raise NotFoundError(f"level {address.level}: precomputed maps are of level 0 only")
        side = found.settings.grid.texels(0)
        dtype = np.int8 if manifest.bits == 8 else np.int16
        return np.full((side, side), 10 * bin + sample, dtype)

    def plans_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[TilePlan]:
        for address in addresses:
            self._check(asset, address)
        return [
            TilePlan(
                str(address),
                self._header(asset, "", query, address),
                self._find(asset).settings.grid.texels(address.level),
                partial(self._draw, asset, positions, query, address),
            )
            for address in addresses
        ]

    def _draw(
        self, asset: str, positions: Any, query: MapQuery, at: TileAddress
    ) -> NDArray[np.float32]:
        self.drawn.append((at, query.method))
        n = self._find(asset).settings.grid.texels(at.level)
        ripple = self._ripple(asset, positions, at.level)
        return ripple[at.row * n : (at.row + 1) * n, at.column * n : (at.column + 1) * n]

    def _ripple(self, asset: str, positions: Any, level: int) -> NDArray[np.float32]:
        settings = self._find(asset).settings
        phase = np.arange(settings.grid.side(level)) / settings.grid.side(level)
        height = (settings.depth or 0.0) * (1 + self._moved(asset, positions))
        ripple = -height * np.abs(np.sin(9 * phase[:, None] + 5 * phase))
        return ripple.astype(np.float32)

    def _moved(self, asset: str, positions: Any) -> float:
        return float(np.abs(positions - self._find(asset).new.mesh.positions).max())

    def _find(self, asset: str) -> FakeAsset:
        if asset not in self._assets:
            raise NotFoundError(f"no asset {asset!r}")
        return self._assets[asset]

    def _built(self, asset: str) -> FakeAsset:
        found = self._find(asset)
        if self._jobs[found.job].state != "done":
            raise NotReadyError(f"asset {asset} is still building")
        return found

    def _check(self, asset: str, address: TileAddress) -> FakeAsset:
        found = self._built(asset)
        if address.udim not in mesh_udims(found.new.mesh):
            raise NotFoundError(f"asset {asset} has no UDIM {address.udim}")
        found.settings.grid.check(address)
        return found


def _digest(text: str, *arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256(text.encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
