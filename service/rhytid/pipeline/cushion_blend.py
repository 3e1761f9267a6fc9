"""Blends the precomputed maps of the broad layer: each sample by the stretch of its owner. Kernels:
ends.cl, blend_cushions.cl."""

from __future__ import annotations

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import CODES, EVEN, ShareRange, code_limit
from rhytid.pipeline.cushion import MORE, SAMPLES, CushionTile, cushion_steps, last_stretch
from rhytid.pipeline.reach import SCALE_LIMIT, response_defines
from rhytid.pipeline.vectors import VECTOR


class CushionBlend:
    """Blends tiles of the broad layer of one asset."""

    def __init__(self, device: Device, settings: AssetSettings, shares: ShareRange = EVEN) -> None:
        """shares: of the graph of the asset."""
        bits, response = settings.bins.bits, settings.response
        self._device = device
        self._steps = device.upload(cushion_steps(settings, shares))
        self._last = np.float32(last_stretch(settings))
        self._depth = np.array([response.alpha_d, SCALE_LIMIT], np.float32)
        self._defines: dict[str, object] = {
            **response_defines(response.soft_limits),
            "SAMPLES": SAMPLES,
            "CODE": CODES[bits],
            "CODE_BITS": bits,
            "CODE_LIMIT": code_limit(bits),
        }

    def tile(self, maps: CushionTile, lines: Buffer) -> Buffer:
        """float32 displacement of the samples of a tile, on the device, with MORE values behind
        them.

        lines: `ends` of LineStretches.
        """
        out = self._device.empty(maps.side**2 + MORE, np.float32)
        self._device.launch(
            "blend_cushions", "blend_cushions", (maps.side**2 // VECTOR,),
            maps.owners, maps.codes, lines, self._steps, self._last, self._depth, out,
            defines=self._defines,
        )  # fmt: skip
        return out

    def release(self) -> None:
        """Give the memory back."""
        self._steps.release()
