"""Graphs, meshes and the stages in a row, for tests of single stages against the reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes import Positions, bumpy_grid
from reference import cushion, locate, redraw, stretch, stretch_models, waves
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.element_arrays import pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import render_to_host
from rhytid.pipeline.locate import locate_points
from rhytid.pipeline.redraw import redrawing, respond
from rhytid.pipeline.stretch import StretchBuffers, StretchStage
from rhytid.pipeline.waves import wrinkle_waves

DEPTH = 0.03
# What float32 coordinates within a UDIM round to, with room for a cross product.
EDGE_BAND = 1e-6
MODELS = {
    "tensor": stretch.stretch,
    "tension": stretch_models.tension,
    "uv": stretch_models.uv_stretch,
}
Places = NDArray[np.floating[Any]]


def settings_of(**changes: Any) -> AssetSettings:
    """Settings with a depth, 256 texels, tiles of 64 and the paper's bins, and what is given."""
    given = {"depth": DEPTH, "resolution": 256, "tile_size": 64, "preset": "paper", **changes}
    return AssetSettings.parse(given)


def sheet(n: int = 10, seed: int = 1, udims: int = 1) -> Mesh:
    """A bumpy sheet whose UV covers `udims` x `udims` UDIMs."""
    positions, faces, uv, face_uv = bumpy_grid(n, seed)
    return Mesh(positions, faces, uv * udims, face_uv)


def random_graph(
    seed: int,
    wrinkles: int = 80,
    half_width: tuple[float, float] = (0.01, 0.05),
    length: tuple[float, float] = (0.01, 0.4),
    span: float = 1.0,
    metric: bool = False,
) -> WrinkleGraph:
    """Wrinkles with ends of their own, over [0, span]² and beyond; sizes in UV, evenly on a log
    scale. Every pore is as wide as a wrinkle."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.02, 1.02, (wrinkles, 2)) * span
    angle = rng.uniform(0, 2 * np.pi, wrinkles)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    node_uv = np.concatenate([start, start + log_uniform(rng, *length, (wrinkles, 1)) * along])
    radius = log_uniform(rng, *half_width, 2 * wrinkles)
    return WrinkleGraph(
        node_uv=node_uv.astype(np.float32),
        node_weight=rng.uniform(0, 1, 2 * wrinkles).astype(np.float32),
        node_radius=radius.astype(np.float32),
        edge_nodes=np.stack([np.arange(wrinkles), np.arange(wrinkles) + wrinkles], axis=1),
        edge_weight=rng.uniform(0, 1, wrinkles).astype(np.float32),
        edge_half_width=log_uniform(rng, *half_width, wrinkles).astype(np.float32),
        node_metric=ellipses(rng, radius) if metric else None,
    )


def log_uniform(rng: np.random.Generator, low: float, high: float, size: Any) -> Places:
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


def ellipses(rng: np.random.Generator, radius: Places) -> NDArray[np.float32]:
    """(N, 3) metrics of turned ellipses as long as `radius` and down to a tenth of it across."""
    angle = rng.uniform(0, np.pi, len(radius))
    c, s = np.cos(angle), np.sin(angle)
    a, b = radius**-2, (radius * rng.uniform(0.1, 1, len(radius))) ** -2
    metric = [a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c]
    return np.stack(metric, axis=1).astype(np.float32)


class Scene:
    """A mesh, a graph on it and settings; the product's side and the reference's side.

    What has its centre on an edge of two triangles, as far as float32 goes, is given no strength:
    either triangle would be right.
    """

    def __init__(
        self, device: Device, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
    ) -> None:
        self.device, self.mesh, self.settings = device, mesh, settings
        ends = graph.node_uv[graph.edge_nodes]
        self.middles = (0.5 * (ends[:, 0] + ends[:, 1])).astype(np.float32)
        self._wrinkle, sure_wrinkle = self._held(self.middles)
        self._pore, sure_pore = self._held(graph.node_uv)
        self.graph = replace(
            graph,
            edge_weight=graph.edge_weight * sure_wrinkle,
            node_weight=graph.node_weight * sure_pore,
        )

    def elements(self, udim: int = 1001) -> UdimElements:
        settings = self.settings
        wrinkle, pore = (
            locate_points(self.device, self.mesh, uv, settings.resolution, settings.padding)
            for uv in (self.middles, self.graph.node_uv)
        )
        wavy = wrinkle_waves(self.mesh, self.graph, wrinkle, settings.shape)
        return UdimElements(
            self.device,
            wrinkle_arrays(self.graph, wrinkle, settings, udim, waves=wavy),
            pore_arrays(self.graph, pore, settings, udim),
            settings.bins.count,
        )

    def stretch(self, positions: Positions | None, model: str = "tensor") -> StretchBuffers:
        response, angles = self.settings.response, self.settings.angles
        stage = StretchStage(self.device, self.mesh)
        limit, soft = response.log_stretch_limit, response.soft_limits
        return stage.run(positions, limit, model, angles, soft)

    def redrawn(
        self,
        positions: Positions | None,
        udim: int = 1001,
        level: int = 0,
        at: tuple[int, int] = (0, 0),
        side: int | None = None,
        model: str = "tensor",
    ) -> NDArray[np.float32]:
        """(side, side) displacement by the product."""
        elements = self.elements(udim)
        scales = respond(self.device, elements, self.settings, self.stretch(positions, model))
        draw = redrawing(self.device, elements, self.settings, scales)
        side = side or self.settings.resolution >> level
        return render_to_host(self.device, draw, level, *at, side)

    def expected(
        self,
        points: NDArray[np.float64],
        positions: Positions,
        udim: int = 1001,
        model: str = "tensor",
    ) -> NDArray[np.float64]:
        """(P,) displacement by the reference at points local to the UDIM."""
        logs, axes = self.reference_logs(positions, model)
        settings, origin = self.settings, udim_origin(udim)
        return redraw.redraw(
            points,
            self.graph,
            locate.sample(self._wrinkle, logs, axes),
            locate.sample(self._pore, logs, axes),
            settings.response,
            settings.shape,
            DEPTH,
            origin,
            waves=self.reference_waves(),
            cushion=self.reference_cushion(),
        )

    def reference_cushion(self) -> cushion.Cushion | None:
        """None where plates do not swell."""
        shape = self.settings.shape
        if shape.cushion == 0:
            return None
        return cushion.Cushion.of(
            self.graph, self.settings.resolution,
            shape.cushion, shape.cushion_width, shape.cushion_sharpness,
        )  # fmt: skip

    def reference_waves(self) -> waves.Waves | None:
        """Of the wrinkles, none of which crosses a seam; None where all are straight."""
        shape = self.settings.shape
        if shape.wave_amplitude == 0:
            return None
        corners = self.mesh.positions[self.mesh.faces].astype(np.float64)
        return waves.on_mesh(
            self.graph, corners, self.mesh.triangle_uv(), self._wrinkle,
            shape.wave_amplitude, shape.wave_frequency,
        )  # fmt: skip

    def reference_logs(self, positions: Positions, model: str = "tensor") -> redraw.Stretch:
        """Clamped log stretch (F, 2) and axes (F, 2, 2)."""
        ratios, axes = reference_stretch(self.mesh, positions, model)
        return stretch.log_stretch(ratios, self.settings.response.log_stretch_limit), axes

    def _held(self, uv: Places) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """(P,) triangle of each point, -1 for none, and whether that is sure."""
        padding = self.settings.padding / self.settings.resolution
        index, margin = locate.locate(uv, self.mesh.triangle_uv(), padding)
        sure = margin > EDGE_BAND
        assert sure.mean() > 0.98
        return index, sure


def reference_stretch(
    mesh: Mesh, positions: NDArray[np.float32], model: str = "tensor"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ratios (F, 2) and axes (F, 2, 2)."""
    found = MODELS[model](mesh.positions, mesh.faces, mesh.uv, mesh.face_uv, positions)
    return found
