"""Per-triangle stretch of a frame (section 2.2, after Nagano et al. 2015). Kernel: stretch.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.mesh import Mesh


@dataclass(frozen=True)
class Rest:
    """What stretch needs of the neutral, per triangle, made once in double.

    shape: (F, 8) float32: 1/l, d/l, 1/h, each as a high and a low part; l is the length of the
    first edge, (d, h) the second edge in its frame. All zero for a triangle without usable area.
    frame_to_uv: (F, 4) float32: the matrix from that frame to UV, row by row.
    """

    shape: NDArray[np.float32]
    frame_to_uv: NDArray[np.float32]

    @classmethod
    def of(cls, mesh: Mesh) -> Rest:
        """From a mesh; every length is in mesh units."""
        usable = mesh.usable_triangles()
        corners = mesh.positions[mesh.faces].astype(np.float64)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        length = np.where(usable, np.linalg.norm(first, axis=1), 1.0)
        d = np.where(usable, np.sum(first * second, axis=1) / length, 0.0)
        h = np.where(usable, np.linalg.norm(np.cross(first, second), axis=1) / length, 1.0)
        values = np.stack([1.0 / length, d / length, 1.0 / h], axis=1) * usable[:, None]
        return cls(_in_two_parts(values), _frame_to_uv(mesh, length, d, h))


@dataclass(frozen=True)
class StretchBuffers:
    """Stretch on the device, F triangles and one neutral entry for points in no triangle.

    ratios: float2, unclamped.  axes: float4, (ŝ₁, ŝ₂).  logs: float2, log ρ, clamped.
    """

    ratios: Buffer
    axes: Buffer
    logs: Buffer

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return self.ratios.nbytes + self.axes.nbytes + self.logs.nbytes

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self.ratios, self.axes, self.logs):
            buffer.release()


class StretchStage:
    """The triangles of an asset, ready to be stretched."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        rest = Rest.of(mesh)
        self._device = device
        self.triangles = len(mesh.faces)
        self._neutral = mesh.positions
        self._faces = device.upload(mesh.faces)
        self._shape = device.upload(rest.shape)
        self._frame_to_uv = device.upload(rest.frame_to_uv)

    def run(self, positions: NDArray[np.float32] | None, limit: float) -> StretchBuffers:
        """Stretch of deformed positions (V, 3); of the neutral by definition where None."""
        device, count = self._device, self.triangles + 1
        found = StretchBuffers(
            device.empty(2 * count, np.float32),
            device.empty(4 * count, np.float32),
            device.empty(2 * count, np.float32),
        )
        frame = device.upload(self._neutral if positions is None else positions)
        # No triangle is stretched in the neutral frame, whatever rounding would say.
        triangles = 0 if positions is None else self.triangles
        device.launch(
            "stretch", "stretch_tensor", (count,),
            frame, self._faces, self._shape, self._frame_to_uv,
            np.int32(triangles), np.float32(limit), found.ratios, found.axes, found.logs,
        )  # fmt: skip
        frame.release()
        return found

    def read(self, found: StretchBuffers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(ratios (F, 2) unclamped, axes (F, 2, 2) with axes[f, i] = ŝᵢ) on the host."""
        ratios = self._device.read(found.ratios, (self.triangles, 2), np.float32)
        axes = self._device.read(found.axes, (self.triangles, 2, 2), np.float32)
        return ratios, axes

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self._faces, self._shape, self._frame_to_uv):
            buffer.release()


def r_max_of(ratios: NDArray[np.float32], limit: float) -> float:
    """The calibrated maximal log stretch (section 2.4): the 90th percentile of |log ρ|,
    unclamped, over all triangles and both axes, kept within [0.01, limit]."""
    with np.errstate(divide="ignore"):
        size = np.abs(np.log(ratios.astype(np.float64)))
    # Between two infinities there is no percentile; far beyond the limit one number does as well.
    return float(np.clip(np.percentile(np.minimum(size, 1e6), 90.0), 0.01, limit))


def _in_two_parts(values: NDArray[np.float64]) -> NDArray[np.float32]:
    high = values.astype(np.float32)
    low = (values - high).astype(np.float32)
    parts = np.zeros((len(values), 8), np.float32)
    parts[:, 0:6:2], parts[:, 1:6:2] = high, low
    return parts


def _frame_to_uv(
    mesh: Mesh, length: NDArray[np.float64], d: NDArray[np.float64], h: NDArray[np.float64]
) -> NDArray[np.float32]:
    # B A⁻¹: A = [[l, d], [0, h]] holds the edges in the frame, B the same edges in UV. Only the
    # direction of its columns counts, so it is scaled to stay inside float32.
    corners = mesh.triangle_uv()
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = first / length[:, None]
    across = (second - along * d[:, None]) / h[:, None]
    matrix = np.stack([along[:, 0], across[:, 0], along[:, 1], across[:, 1]], axis=1)
    size = np.abs(matrix).max(axis=1, keepdims=True)
    return np.where(size > 0, matrix / np.where(size > 0, size, 1.0), 0.0).astype(np.float32)
