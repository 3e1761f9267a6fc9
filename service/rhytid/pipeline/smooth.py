"""Stretch without steps at triangle edges. Kernels: smooth.cl.

The metric and the log stretch of the triangles are averaged to the UV vertices and interpolated
inside each triangle; a point takes the principal stretches of what it finds there. A step remains
only where the UV have a seam.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.nearby import Groups
from rhytid.pipeline.reach import response_defines
from rhytid.pipeline.redraw import Responder, ScaleBuffers, respond_with
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.uv_vertices import UvVertices, unit_jacobians


@dataclass(frozen=True)
class SmoothFields(BufferGroup):
    """Metric and log stretch of the UV vertices in one frame, on the device.

    values: float8 a UV vertex (G uu, uv, vv, H uu, uv, vv, 0, 0).  corners: of each triangle, the
    stage's.  limit: what log stretch was clamped to.  neutral: values of the neutral for angles on
    the surface, or None; the stage's.  model: of stretch.
    """

    values: Buffer
    corners: Buffer
    limit: float
    neutral: Buffer | None = None
    model: str = "tensor"

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.values,)

    def arguments(self, located: UdimTriangles) -> tuple[object, ...]:
        """The arguments of every kernel that samples the fields, in order."""
        uv, none = located.corners, located.none
        return (uv, self.corners, self.values, none, np.float32(self.limit))


class SmoothStage:
    """The UV vertices of an asset, ready to take the stretch of any frame.

    neutral: fields of the neutral, for its metric G.  unit: mesh units that a 1 in G stands for,
    squared.  slowest: (F,) a bound from below of |J ŝ|, mesh units, at any point of each triangle.
    """

    def __init__(self, device: Device, mesh: Mesh) -> None:
        jacobians, used, self.unit = unit_jacobians(mesh)
        vertices = UvVertices.of(mesh, used)
        self._device, self._count = device, len(vertices.vertex)
        self._triangles = len(mesh.faces)
        self.slowest = self.unit * vertices.slowest(jacobians)
        self._jacobians = device.upload(jacobians)
        self._vertex = device.upload(vertices.vertex)
        self._corners = device.upload(vertices.corners)
        self._means = (
            device.upload(vertices.offsets),
            device.upload(vertices.members),
            device.upload(vertices.shares),
        )
        self.neutral = self._neutral_fields()

    def run(self, stretch: StretchBuffers, limit: float, soft: bool = False) -> SmoothFields:
        """The fields of a frame whose `stretch` any model measured; angles are compared where they
        are for `stretch`.

        limit: of |log ρ|.  soft: log stretch goes to its limit by a knee.
        """
        values = self._fields(f"{stretch.model}_fields", *self._inputs(stretch, limit), soft=soft)
        neutral = None if stretch.jacobians is None else self.neutral
        return SmoothFields(values, self._corners, limit, neutral, stretch.model)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self._jacobians, self._vertex, self._corners, *self._means, self.neutral):
            buffer.release()

    def _fields(self, kernel: str, *inputs: object, soft: bool = False) -> Buffer:
        values = self._device.empty(8 * self._count, np.float32)
        defines = response_defines(soft)
        self._device.launch("smooth", kernel, (self._count,), *inputs, values, defines=defines)
        return values

    def _neutral_fields(self) -> Buffer:
        """The metric of the neutral at the UV vertices, which no model changes."""
        axes = self._device.upload(np.tile(np.eye(2, dtype=np.float32), (self._triangles, 1)))
        logs = self._device.upload(np.zeros((self._triangles, 2), np.float32))
        values = self._fields("tensor_fields", *self._means, self._jacobians, axes, logs)
        self._device.finish()
        axes.release()
        logs.release()
        return values

    def _inputs(self, stretch: StretchBuffers, limit: float) -> tuple[object, ...]:
        if stretch.model == "tension":
            return (self._vertex, stretch.tension, np.float32(limit))
        if stretch.model == "uv":
            return (*self._means, stretch.logs)
        return (*self._means, self._jacobians, stretch.axes, stretch.logs)


def respond_smooth(
    device: Device,
    elements: UdimElements,
    located: UdimTriangles,
    settings: AssetSettings,
    fields: SmoothFields,
) -> ScaleBuffers:
    """Alg. 1 for every wrinkle and Alg. 2 for every pore, each at its own point."""
    scales = ScaleBuffers.allocate(device, elements)
    defines = elements.response_defines
    wrinkles = smooth_wrinkle_responder(device, located, settings, fields, defines)
    pores = smooth_pore_responder(device, located, settings, fields)
    respond_with(device, elements, settings, scales, wrinkles, pores)
    return scales


def smooth_wrinkle_responder(
    device: Device,
    located: UdimTriangles,
    settings: AssetSettings,
    fields: SmoothFields,
    defines: Mapping[str, object],
) -> Responder:
    """Launches Alg. 1 with the stretch at each middle.

    defines: as of `wrinkle_responder`.
    """
    response, texels = settings.response, np.float32(settings.resolution)
    limits = response_defines(response.soft_limits)

    def wrinkles(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer,
        groups: Groups | None = None,
    ) -> None:  # fmt: skip
        assert groups is None  # each at its own point: all are found at once
        device.launch(
            "smooth", "respond_smooth_wrinkles", (count,),
            places, triangle, texels, *fields.arguments(located), fields.neutral, stiff,
            np.float32(response.alpha_w), np.float32(response.alpha_d), into,
            defines={**limits, **defines},
        )  # fmt: skip

    return wrinkles


def smooth_pore_responder(
    device: Device, located: UdimTriangles, settings: AssetSettings, fields: SmoothFields
) -> Responder:
    """Launches Alg. 2 with the stretch at each point."""
    response, texels = settings.response, np.float32(settings.resolution)

    def pores(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer,
        groups: Groups | None = None,
    ) -> None:  # fmt: skip
        assert groups is None  # each at its own point: all are found at once
        device.launch(
            "smooth", "respond_smooth_pores", (count,),
            places, triangle, texels, *fields.arguments(located), stiff,
            np.float32(response.beta_w), np.float32(response.beta_d),
            np.float32(response.pore_depth_limit), into,
            defines=response_defines(response.soft_limits),
        )  # fmt: skip

    return pores
