"""Blends precomputed maps by the stretch of a frame (Alg. 3). Kernels: weights.cl, blend.cl."""

from __future__ import annotations

import numpy as np

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import CODES, VECTOR, BinTile, directions, quantisation_steps
from rhytid.pipeline.elements import RESPONSE_DEFINES
from rhytid.pipeline.stretch import StretchBuffers


class Blend:
    """What blending needs of an asset, on the device."""

    def __init__(self, device: Device, settings: AssetSettings, triangles: int) -> None:
        self._device, self._bins, self._triangles = device, settings.bins, triangles
        self._directions = device.upload(directions(settings.bins.count).astype(np.float32))
        self._steps = device.upload(quantisation_steps(settings))
        self._layers: dict[str, object] = {
            "LAYERS": settings.bins.count + 1,
            "SAMPLES": settings.bins.samples,
        }

    def positions(self, stretch: StretchBuffers) -> Buffer:
        """Where each triangle stands between the samples, per layer (Alg. 3, lines 6 to 10)."""
        count = self._triangles + 1
        found = self._device.empty(count * (self._bins.count + 1), np.float32)
        self._device.launch(
            "weights", "sample_positions", (count,),
            stretch.axes, stretch.logs, self._directions, np.float32(self._bins.r_max), found,
            defines={
                **self._layers,
                **RESPONSE_DEFINES,
                "ORIENTED": self._bins.count if self._bins.count > 1 else 0,
            },
        )  # fmt: skip
        return found

    def tile(self, maps: BinTile, positions: Buffer) -> Buffer:
        """float32 displacement of one tile, on the device (Alg. 3, lines 11 to 15)."""
        out = self._device.empty(maps.texels, np.float32)
        bits = self._bins.bits
        self._device.launch(
            "blend", "blend", (maps.texels // VECTOR,),
            maps.triangles, maps.codes, positions, self._steps, np.int32(maps.texels), out,
            defines={"CODE": CODES[bits], "CODE_BITS": bits, **self._layers},
        )  # fmt: skip
        return out

    def release(self) -> None:
        """Give the memory back."""
        self._directions.release()
        self._steps.release()
