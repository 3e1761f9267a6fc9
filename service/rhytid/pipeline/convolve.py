"""Convolves the neutral map along the axes of stretch (after Nagano et al. 2015), with the stretch
of each triangle or, smooth, of each texel. Kernels: convolve.cl, convolve_smooth.cl.

What no frame changes, a tile of the neutral map with its surroundings, is made once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.smooth import SmoothFields, SmoothStage
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK

# Taps on either side of a texel, at most: 3 sigma, so that sigma is 21 texels at most.
MOST_TAPS = 63
_LARGEST_FLOAT = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class NeutralTile(BufferGroup):
    """The inputs of convolving `side`² texels from (row, column) on that no frame changes.

    heights: (side + 4 apron)² float32, the neutral map around the tile; beyond the border of the
    map the texel at the border.  triangles: (side + 2 apron)² int32, which holds each texel.
    stiffness: float32 of the same texels, or None: 1 throughout.
    """

    row: int
    column: int
    side: int
    apron: int
    heights: Buffer
    triangles: Buffer
    stiffness: Buffer | None = None

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.heights, self.triangles, self.stiffness)


class NeutralTiles:
    """Makes the neutral tiles of a mesh.

    slowest: (F,) float64, the least |J ŝ| that a texel in each triangle can have, whatever the
    frame; infinite where none is convolved.
    """

    def __init__(
        self, device: Device, mesh: Mesh, slowest: NDArray[np.float64], stiffness: Stiffness | None
    ) -> None:
        self._device, self._stiffness = device, stiffness
        self._slowest = slowest
        self._uv = mesh.triangle_uv()

    def neutral_tile(
        self, draw: Draw, located: UdimTriangles, settings: AssetSettings,
        udim: int, row: int, column: int, side: int,
    ) -> NeutralTile:  # fmt: skip
        """The neutral tile for a tile of level 0, of `side`² texels from (row, column) on.

        draw: draws the neutral map.
        """
        apron = self.apron(settings, udim, row, column, side)
        resolution = settings.resolution
        heights = _extended(
            self._device, draw, resolution, row - 2 * apron, column - 2 * apron, side + 4 * apron
        )
        triangles = located.texels(resolution, row - apron, column - apron, side + 2 * apron)
        stiffness = stiffness_of_texels(
            self._device, self._stiffness, udim, resolution, row - apron, column - apron,
            side + 2 * apron,
        )  # fmt: skip
        return NeutralTile(row, column, side, apron, heights, triangles, stiffness)

    def apron(self, settings: AssetSettings, udim: int, row: int, column: int, side: int) -> int:
        """How many texels beyond a tile one pass reads at most, in any frame; a multiple of VECTOR.

        The cost of a tile depends on it, its bits do not.
        """
        resolution = settings.resolution
        margin = (MOST_TAPS + 1 + settings.padding + 1) / resolution
        low = np.array([column, resolution - row - side]) / resolution - margin
        high = low + side / resolution + 2 * margin
        corners = self._uv - udim_origin(udim)
        touches = (corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)
        slowest = self._slowest[touches.all(axis=1)].min(initial=np.inf)
        # One more for rounding, one for the texel that bilinear reads beside the last tap.
        taps = min(3.0 * reach(settings) / slowest + 1.0, MOST_TAPS) + 1.0
        return VECTOR * int(np.ceil(taps / VECTOR))


def reach(settings: AssetSettings) -> float:
    """σ in mesh units times texels per side: over |J ŝ| it is σ in texels."""
    assert settings.convolve.sigma is not None
    return settings.convolve.sigma * settings.resolution


def _extended(
    device: Device, draw: Draw, resolution: int, row: int, column: int, side: int
) -> Buffer:
    """`side`² texels from (row, column) on, which may lie beyond the border of the map."""
    blocks = max(-(-(at % BLOCK + side) // BLOCK) for at in (row, column))
    inside = min(blocks * BLOCK, resolution)
    corner = [int(np.clip(at // BLOCK * BLOCK, 0, resolution - inside)) for at in (column, row)]
    part = draw(corner[1], corner[0], inside)
    out = device.empty(side * side, np.float32)
    device.launch(
        "convolve", "extend", (side, side),
        part, np.array(corner, np.int32), np.int32(inside), np.int32(resolution),
        np.int32(row), np.int32(column), out,
    )  # fmt: skip
    part.release()
    return out


class Convolve(NeutralTiles):
    """Convolves tiles of an asset with the stretch of each triangle."""

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


class SmoothConvolve(NeutralTiles):
    """Convolves tiles of an asset with stretch of its own for every texel.

    |J ŝ|, by which σ in UV is divided, comes from the metric G that smooth sampling interpolates,
    |J ŝ|² = ŝᵀGŝ, so that the widths of kernels have no step at triangle edges either.
    """

    def __init__(
        self, device: Device, mesh: Mesh, stage: SmoothStage, stiffness: Stiffness | None = None
    ) -> None:
        super().__init__(device, mesh, stage.slowest, stiffness)
        self._unit, self._metrics = stage.unit, stage.neutral

    def tile(
        self, neutral: NeutralTile, fields: SmoothFields, located: UdimTriangles,
        settings: AssetSettings,
    ) -> Buffer:  # fmt: skip
        """float32 displacement of one tile of level 0, on the device."""
        convolve = settings.convolve
        frame = (
            np.array([convolve.blur_gain, convolve.sharpen_gain], np.float32),
            np.float32(min(reach(settings) / self._unit, _LARGEST_FLOAT)),
            np.float32(MOST_TAPS / 3), self._metrics, np.int32(fields.model == "tensor"),
            *fields.arguments(located),
        )  # fmt: skip
        wide = self._pass(0, neutral, neutral.heights, neutral.apron, settings, frame)
        out = self._pass(1, neutral, wide, 0, settings, frame)
        wide.release()
        return out

    def _pass(
        self, axis: int, neutral: NeutralTile, source: Buffer, apron: int, settings: AssetSettings,
        frame: tuple[object, ...],
    ) -> Buffer:  # fmt: skip
        """One pass over the tile and `apron` texels around it."""
        side = neutral.side + 2 * apron
        out = self._device.empty(side * side, np.float32)
        self._device.launch(
            "convolve_smooth", "convolve_smooth", (side, side),
            source, np.int32(neutral.apron), neutral.triangles, np.int32(neutral.apron - apron),
            neutral.stiffness, np.int32(axis), np.int32(settings.resolution),
            np.int32(neutral.row - apron), np.int32(neutral.column - apron), *frame, out,
        )  # fmt: skip
        return out
