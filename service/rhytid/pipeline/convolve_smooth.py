"""Convolves the neutral map with stretch of its own for every texel. Kernel: convolve_smooth.cl.

|J ŝ|, by which σ in UV is divided, comes from the metric G that smooth sampling interpolates,
|J ŝ|² = ŝᵀGŝ, so that the widths of kernels have no step at triangle edges either.
"""

from __future__ import annotations

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.neutral_tiles import MOST_TAPS, NeutralTile, NeutralTiles, reach
from rhytid.pipeline.smooth import SmoothFields, SmoothStage

_LARGEST_FLOAT = float(np.finfo(np.float32).max)


class SmoothConvolve(NeutralTiles):
    """What smooth convolving needs of an asset."""

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
