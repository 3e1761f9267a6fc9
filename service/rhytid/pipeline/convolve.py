"""Convolves the neutral map along the axes of stretch (after Nagano et al. 2015).
Kernel: convolve.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.pipeline.neutral_tiles import MOST_TAPS, NeutralTile, NeutralTiles, reach
from rhytid.pipeline.stretch_buffers import StretchBuffers
from rhytid.pipeline.vectors import VECTOR


class Convolve(NeutralTiles):
    """What convolving needs of an asset, on the device."""

    def __init__(self, device: Device, mesh: Mesh, stiffness: Stiffness | None = None) -> None:
        jacobians = neutral_jacobians(mesh)
        super().__init__(device, mesh, _slowest(jacobians), stiffness)
        self._jacobians = device.upload(jacobians)

    def kernels(self, stretch: StretchBuffers, settings: AssetSettings) -> Buffer:
        """(F + 1, 2, 4) float32: of each triangle and axis (step x, step y, α, σ), in texels. α is
        not clamped to [−1, 1] until it is multiplied by the stiffness of the texel."""
        convolve = settings.convolve
        found = self._device.empty(8 * stretch.count, np.float32)
        self._device.launch(
            "convolve", "triangle_kernels", (stretch.count,),
            stretch.axes, stretch.logs, self._jacobians,
            np.array([convolve.blur_gain, convolve.sharpen_gain], np.float32),
            np.float32(reach(settings)), np.float32(MOST_TAPS / 3),
            found,
        )  # fmt: skip
        return found

    def tile(self, neutral: NeutralTile, kernels: Buffer, settings: AssetSettings) -> Buffer:
        """float32 displacement of one tile of level 0, on the device."""
        apron, side = neutral.apron, neutral.side
        wide = self._pass(0, neutral, neutral.heights, apron, kernels, settings)
        out = self._pass(1, neutral, wide, 0, kernels, settings)
        assert out.nbytes == 4 * side * side
        wide.release()
        return out

    def release(self) -> None:
        """Give the memory back."""
        self._jacobians.release()

    def _pass(
        self, axis: int, neutral: NeutralTile, source: Buffer, apron: int, kernels: Buffer,
        settings: AssetSettings,
    ) -> Buffer:  # fmt: skip
        """One pass over the tile and `apron` texels around it."""
        side = neutral.side + 2 * apron
        out = self._device.empty(side * side, np.float32)
        self._device.launch(
            "convolve", "convolve", (side // VECTOR, side),
            source, np.int32(neutral.apron), neutral.triangles, np.int32(neutral.apron - apron),
            neutral.stiffness, kernels, np.int32(axis), np.int32(settings.resolution),
            np.int32(neutral.row - apron), np.int32(neutral.column - apron), out,
        )  # fmt: skip
        return out


def neutral_jacobians(mesh: Mesh) -> NDArray[np.float32]:
    """(F + 1, 4): J = ∂X/∂(u, v) into an orthonormal frame of each neutral triangle, row by row.

    All zero for a triangle without usable area, and for the last entry, which stands for none.
    """
    usable = np.flatnonzero(mesh.usable_triangles())
    uv = mesh.triangle_uv()[usable]
    corners = mesh.positions[mesh.faces[usable]].astype(np.float64)
    edges, edges_uv = (np.swapaxes(c[:, 1:] - c[:, :1], 1, 2) for c in (corners, uv))
    jacobians = np.linalg.qr(edges, mode="r") @ np.linalg.inv(edges_uv)
    found = np.zeros((len(mesh.faces) + 1, 4), np.float32)
    found[usable] = np.clip(jacobians, -1e37, 1e37).reshape(-1, 4)
    return found


def _slowest(jacobians: NDArray[np.float32]) -> NDArray[np.float64]:
    """(F,) the least |J ŝ| of any direction; infinite where a triangle is left as it is."""
    matrices = jacobians[:-1].reshape(-1, 2, 2).astype(np.float64)
    least = np.linalg.svd(matrices, compute_uv=False)[:, 1]
    return np.where(matrices.any(axis=(1, 2)), np.maximum(least, 1e-300), np.inf)
