"""Per-triangle stretch of a frame (section 2.2, after Nagano et al. 2015). Kernel: stretch.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch_buffers import LogLimit, StretchBuffers, StretchModel, in_two_parts
from rhytid.pipeline.tension import Tension
from rhytid.pipeline.uv_stretch import UvStretch
from rhytid.pipeline.uv_vertices import unit_jacobians


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
        return cls(in_two_parts(values), _frame_to_uv(mesh, length, d, h))


class Tensor:
    """The stretch tensor of every triangle (section 2.2, after Nagano et al. 2015)."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        rest = Rest.of(mesh)
        self._device = device
        self._shape = device.upload(rest.shape)
        self._frame_to_uv = device.upload(rest.frame_to_uv)

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        self._device.launch(
            "stretch", "stretch_tensor", (found.count,),
            frame, faces, self._shape, self._frame_to_uv,
            np.int32(triangles), np.float32(limit.most), found.ratios, found.axes, found.logs,
            defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        self._shape.release()
        self._frame_to_uv.release()


class StretchStage:
    """The triangles of an asset, ready to be stretched by any model."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        self._device = device
        self.triangles = len(mesh.faces)
        self._neutral = mesh.positions
        self._faces = device.upload(mesh.faces)
        self._jacobians = device.upload(_surface_jacobians(mesh))
        self._models: dict[str, StretchModel] = {
            "tensor": Tensor(device, mesh),
            "tension": Tension(device, mesh),
            "uv": UvStretch(device, mesh),
        }

    def run(
        self,
        positions: NDArray[np.float32] | None,
        limit: float,
        model: str = "tensor",
        angles: str = "uv",
        soft: bool = False,
    ) -> StretchBuffers:
        """Stretch of deformed positions (V, 3); of the neutral by definition where None.

        angles: whether directions are compared in `uv` or on the `surface`. soft: log stretch goes
        to its limit by a knee.
        """
        log_limit = LogLimit(limit, soft)
        jacobians = self._jacobians if angles == "surface" else None
        # The neutral frame is unstretched by definition, in every model, without rounding errors.
        if positions is None:
            return self._measure(self._neutral, 0, log_limit, "tensor", jacobians)
        return self._measure(positions, self.triangles, log_limit, model, jacobians)

    def _measure(
        self,
        positions: NDArray[np.float32],
        triangles: int,
        limit: LogLimit,
        model: str,
        jacobians: Buffer | None,
    ) -> StretchBuffers:
        found = StretchBuffers.allocate(
            self._device, model, self.triangles, len(positions), jacobians
        )
        frame = self._device.upload(positions)
        self._models[model].launch(frame, self._faces, triangles, limit, found)
        frame.release()
        return found

    def read(self, found: StretchBuffers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(ratios (F, 2) unclamped, axes (F, 2, 2) with axes[f, i] = ŝᵢ) on the host."""
        ratios = self._device.read(found.ratios, (self.triangles, 2), np.float32)
        axes = self._device.read(found.axes, (self.triangles, 2, 2), np.float32)
        return ratios, axes

    def release(self) -> None:
        """Give the memory back."""
        self._faces.release()
        self._jacobians.release()
        for model in self._models.values():
            model.release()


def _surface_jacobians(mesh: Mesh) -> NDArray[np.float32]:
    """(F + 1, 4) J of each neutral triangle; the identity, whose angles are those of UV, for
    triangles without area and for the last entry, which stands for none."""
    jacobians, used, _ = unit_jacobians(mesh)
    found = np.tile(np.array([1, 0, 0, 1], np.float32), (len(jacobians) + 1, 1))
    found[:-1][used] = jacobians[used]
    return found


def r_max_of(ratios: NDArray[np.float32], limit: float) -> float:
    """The calibrated maximal log stretch (section 2.4): the 90th percentile of |log ρ|,
    unclamped, over all triangles and both axes, kept within [0.01, limit]."""
    with np.errstate(divide="ignore"):
        size = np.abs(np.log(ratios.astype(np.float64)))
    # Between two infinities there is no percentile; far beyond the limit one number does as well.
    return float(np.clip(np.percentile(np.minimum(size, 1e6), 90.0), 0.01, limit))


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
