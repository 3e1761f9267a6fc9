"""Stretch along the UV axes (Zoss et al. 2020). Kernel: uv_stretch.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch_buffers import LogLimit, StretchBuffers, in_two_parts


class UvStretch:
    """ρ_u = |J'e_u| / |J e_u| and ρ_v likewise, with J = ∂X/∂(u, v); the axes are those of UV."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        self._device = device
        self._weights = device.upload(in_two_parts(uv_weights(mesh)))

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        self._device.launch(
            "uv_stretch", "stretch_uv", (found.count,),
            frame, faces, self._weights, np.int32(triangles), np.float32(limit.most),
            found.ratios, found.axes, found.logs, defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        self._weights.release()


def uv_weights(mesh: Mesh) -> NDArray[np.float64]:
    """(F, 4): (a, b) with J e_u / |J e_u| = a e₁ + b e₂ of the neutral edges, then for e_v.

    All zero for a triangle without usable area.
    """
    usable = mesh.usable_triangles()
    uv = mesh.triangle_uv()
    edges_uv = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=2)
    edges_uv[~usable] = np.eye(2)
    # Column 0 of the inverse holds the weights of e_u, column 1 those of e_v.
    weights = np.linalg.inv(edges_uv)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    length = np.linalg.norm(edges @ weights, axis=1)
    scaled = weights / np.where(usable[:, None], length, 1.0)[:, None, :]
    return np.concatenate([scaled[:, :, 0], scaled[:, :, 1]], axis=1) * usable[:, None]
