"""Assets and jobs of the fake engine."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from api.fake_state import FakeAsset, Part, digest_of
from rhytid.domain.expressions import Expressions
from rhytid.domain.frame import check_positions, counted_frame
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import Curves
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.warnings import check_codes, refuse
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import (
    AssetContent,
    AssetDimensions,
    AssetInfo,
    JobInfo,
    NewAsset,
)
from rhytid.errors import NotFoundError, SettingsError

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


class FakeAssets(Part):
    """Assets are built when their job is done."""

    def create(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        check_codes(allow)
        if strict:
            refuse(self.state.doubts(new.mesh.positions, "mesh"), allow)
        arrays = [new.mesh.positions, new.mesh.faces, new.mesh.uv, new.mesh.face_uv]
        name = digest_of(repr(new.settings), *arrays)[:16]
        if name not in self.state.assets:
            job = self.state.start(name, "build")
            self.state.assets[name] = FakeAsset(new, new.settings.resolved(0.01), job)
            for i, frame in enumerate(() if new.frames is None else new.frames):
                self.state.assets[name].frames[counted_frame(i)] = frame
        return self.info(name)

    def all(self) -> list[AssetInfo]:
        return [self.info(name) for name in self.state.assets]

    def info(self, asset: str) -> AssetInfo:
        found = self.state.find(asset)
        mesh, job = found.new.mesh, self.state.jobs[found.job]
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
            statistics={"spacing": 0.01, "distance": 0.01, **graph.figures()} if built else None,
            warnings=self.state.doubts(mesh.positions, "mesh"),
            centre=tuple(mesh.centre.tolist()),
        )

    def dimensions(self, asset: str) -> AssetDimensions:
        info, found = self.info(asset), self.state.find(asset)
        sizes = (info.vertices, info.triangles, info.udims)
        return AssetDimensions(asset, *sizes, found.settings.grid, info.centre)

    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        found = self.state.built(asset)
        for key in ("resolution", "graph"):
            if key in changes:
                raise SettingsError(f"{key} cannot be changed: send a new asset")
        found.settings = found.settings.changed(changes)
        return self.info(asset)

    def delete(self, asset: str, *, shared: bool = False) -> None:
        del self.state.jobs[self.state.find(asset).job]
        del self.state.assets[asset]

    def graph(self, asset: str) -> WrinkleGraph:
        return self.state.built(asset).new.graph or GRAPH

    def content(self, asset: str) -> AssetContent:
        return AssetContent(digest_of(repr((asset, self.state.built(asset).settings))), 1 << 10)

    def mesh(self, asset: str) -> Mesh:
        return self.state.built(asset).new.mesh

    def shapes(self, asset: str) -> Expressions:
        shapes = self.state.built(asset).new.shapes
        if shapes is None or not shapes.named:
            raise NotFoundError(f"asset {asset} has no named shapes")
        return shapes

    def shapes_nbytes(self, asset: str) -> int:
        return int(self.shapes(asset).positions.nbytes)

    def curves(self, asset: str) -> Curves:
        self.state.built(asset)
        return CURVES

    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        found = self.state.built(asset)
        warnings = self.state.judged(positions, "the positions", strict, allow)
        check_positions(positions, len(found.new.mesh.positions))
        found.settings = found.settings.with_r_max(0.3)
        name = self.state.start(asset, "calibrate")
        self.state.jobs[name] = replace(self.state.jobs[name], warnings=warnings)
        return self.state.jobs[name]


class FakeJobs(Part):
    """Jobs move on with every look at them."""

    def info(self, id: str) -> JobInfo:
        return self.state.job(id)

    def cancel(self, id: str) -> JobInfo:
        info = self.state.job(id)
        if info.state != "done":
            self.state.jobs[id] = replace(info, state="cancelled", detail="by the caller")
        return self.state.jobs[id]
