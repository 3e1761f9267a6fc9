"""A scene with smooth sampling: the product's side and the reference's side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes import Positions
from pipeline.scenes import DEPTH, Scene, settings_of
from reference import redraw, smooth, stretch
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.levels import render_to_host
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import redrawing
from rhytid.pipeline.smooth import SmoothFields, SmoothStage, respond_smooth
from rhytid.pipeline.stretch import StretchStage

MODELS = ("tensor", "tension", "uv")
LIMIT = 0.5
Array = NDArray[np.float64]


def mesh_of(mesh: Mesh) -> tuple[NDArray[Any], ...]:
    return mesh.positions, mesh.faces, mesh.uv, mesh.face_uv


def reference_fields(mesh: Mesh, positions: Positions, model: str) -> tuple[Array, Array]:
    """G and H (W, 2, 2)."""
    if model == "tensor":
        return smooth.tensor_fields(*mesh_of(mesh), positions, LIMIT)
    vertex, owner = smooth.corners(*mesh_of(mesh)[1:])
    if model == "tension":
        r = stretch.log_stretch(smooth.tension(mesh.positions, mesh.faces, positions), LIMIT)
        return smooth.diagonal_fields(np.stack([r[vertex]] * 2, axis=1))
    logs, area = smooth.uv_logs(*mesh_of(mesh), positions, LIMIT)
    return smooth.diagonal_fields(smooth.mean(logs, area, owner)[0])


def reference_sample(
    mesh: Mesh, positions: Positions, model: str, points: Array, triangle: NDArray[np.int64]
) -> tuple[Array, Array]:
    """log ρ (P, 2) and axes (P, 2, 2) at points (P, 2) with UDIM, in triangle (P,), -1 = none."""
    owner = smooth.corners(*mesh_of(mesh)[1:])[1]
    fields = reference_fields(mesh, positions, model)
    return smooth.sample(points, triangle, mesh.triangle_uv(), owner, fields)


def fields_of(
    device: Device, mesh: Mesh, positions: Positions | None, model: str = "tensor"
) -> SmoothFields:
    found = StretchStage(device, mesh).run(positions, LIMIT, model)
    return SmoothStage(device, mesh).run(found, LIMIT)


def stretch_at(
    device: Device, mesh: Mesh, positions: Positions | None, uv: Array, model: str = "tensor"
) -> Array:
    """(P, 3) r at points of UDIM 1001, read off widths: of a wrinkle along u, of one along v, of
    a pore."""
    settings = settings_of(response={"alpha_w": 1.0, "beta_w": 1.0})
    located = UdimTriangles(device, mesh, 1001, settings.resolution, settings.padding)
    fields = fields_of(device, mesh, positions, model)
    triangle = located.points(uv.astype(np.float32))
    widths = []
    for along in ((1, 0), (0, 1)):
        points = Points(device, uv * settings.resolution, np.array(along), triangle)
        scales = respond_smooth(device, points, located, settings, fields)
        widths.append(device.read(scales.wrinkles, (len(uv), 2), np.float32)[:, 0])
    widths.append(device.read(scales.pores, (len(uv), 2), np.float32)[:, 0])
    return np.log(np.stack(widths, axis=1).astype(np.float64))


class Points:
    """Wrinkles and pores on the same points, in texels, as far as a response looks at them."""

    def __init__(
        self, device: Device, centres: Array, along: Array, triangle: NDArray[np.int32]
    ) -> None:
        extent = np.tile(2.0 * along, (len(centres), 1))
        segments = np.concatenate([centres - extent / 2, extent], axis=1)
        self.wrinkles = self.pores = len(centres)
        self.wrinkle_origins = self.pore_origins = None
        self.bent, self.response_defines = False, {}
        self.segments = device.upload(segments.astype(np.float32))
        self.centres = device.upload(centres.astype(np.float32))
        self.wrinkle_triangle = self.pore_triangle = device.upload(triangle)
        self.wrinkle_stiffness = self.pore_stiffness = None


class SmoothScene(Scene):
    """A scene whose wrinkles and pores take the stretch of their own points."""

    def redrawn_smooth(self, positions: Positions, model: str, udim: int) -> NDArray[np.float32]:
        settings = self.settings
        elements = self.elements(udim)
        located = UdimTriangles(self.device, self.mesh, udim, settings.resolution, settings.padding)
        fields = fields_of(self.device, self.mesh, positions, model)
        scales = respond_smooth(self.device, elements, located, settings, fields)
        draw = redrawing(self.device, elements, settings, scales)
        return render_to_host(self.device, draw, 0, 0, 0, settings.resolution)

    def expected_smooth(self, points: Array, positions: Positions, model: str, udim: int) -> Array:
        """(P,) displacement by the reference at points local to the UDIM."""
        sampled = (
            reference_sample(self.mesh, positions, model, uv, triangle)
            for uv, triangle in ((self.middles, self._wrinkle), (self.graph.node_uv, self._pore))
        )
        settings, origin = self.settings, udim_origin(udim)
        return redraw.redraw(
            points, self.graph, *sampled, settings.response, settings.shape, DEPTH, origin
        )
