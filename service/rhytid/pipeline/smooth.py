"""Stretch without steps at triangle edges. Kernels: smooth.cl.

The metric and the log stretch of the triangles are averaged to the UV vertices and interpolated
inside each triangle; a point takes the principal stretches of what it finds there. A step remains
only where the UV have a seam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.elements import RESPONSE_DEFINES, UdimElements
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import ScaleBuffers
from rhytid.pipeline.stretch_buffers import StretchBuffers
from rhytid.pipeline.uv_vertices import UvVertices, unit_jacobians


@dataclass(frozen=True)
class SmoothFields:
    """Metric and log stretch of the UV vertices in one frame, on the device.

    values: float8 a UV vertex (G uu, uv, vv, H uu, uv, vv, 0, 0).  corners: of each triangle, the
    stage's.  limit: what log stretch was clamped to.
    """

    values: Buffer
    corners: Buffer
    limit: float

    @property
    def nbytes(self) -> int:
        """Bytes on the device that are this frame's."""
        return self.values.nbytes

    def arguments(self, located: UdimTriangles) -> tuple[object, ...]:
        """What every kernel that samples them takes, in order."""
        uv, none = located.corners, located.none
        return (uv, self.corners, self.values, none, np.float32(self.limit))

    def release(self) -> None:
        """Give the memory back."""
        self.values.release()


class SmoothStage:
    """The UV vertices of an asset, ready to take the stretch of any frame."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        jacobians, used = unit_jacobians(mesh)
        vertices = UvVertices.of(mesh, used)
        self._device, self._count = device, len(vertices.vertex)
        self._jacobians = device.upload(jacobians)
        self._vertex = device.upload(vertices.vertex)
        self._corners = device.upload(vertices.corners)
        self._means = (
            device.upload(vertices.offsets),
            device.upload(vertices.members),
            device.upload(vertices.shares),
        )

    def run(self, stretch: StretchBuffers, limit: float) -> SmoothFields:
        """The fields of a frame, whatever model measured it."""
        values = self._device.empty(8 * self._count, np.float32)
        self._device.launch(
            "smooth", f"{stretch.model}_fields", (self._count,),
            *self._inputs(stretch, limit), values, defines=RESPONSE_DEFINES,
        )  # fmt: skip
        return SmoothFields(values, self._corners, limit)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self._jacobians, self._vertex, self._corners, *self._means):
            buffer.release()

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
    response, texels = settings.response, np.float32(settings.resolution)
    scales = ScaleBuffers.allocate(device, elements)
    device.launch(
        "smooth", "respond_smooth_wrinkles", (elements.wrinkles,),
        elements.segments, elements.wrinkle_triangle, texels, *fields.arguments(located),
        np.float32(response.alpha_w), np.float32(response.alpha_d), scales.wrinkles,
        defines=RESPONSE_DEFINES,
    )  # fmt: skip
    device.launch(
        "smooth", "respond_smooth_pores", (elements.pores,),
        elements.centres, elements.pore_triangle, texels, *fields.arguments(located),
        np.float32(response.beta_w), np.float32(response.beta_d), scales.pores,
        defines=RESPONSE_DEFINES,
    )  # fmt: skip
    return scales
