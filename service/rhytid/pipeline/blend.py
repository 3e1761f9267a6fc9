"""Blends precomputed maps by the stretch of a frame (Alg. 3). Kernels: weights.cl, blend.cl,
blend_smooth.cl, blend_stiff.cl."""

from __future__ import annotations

import numpy as np

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import CODES, BinTile, directions, parts, quantisation_steps
from rhytid.pipeline.elements import RESPONSE_DEFINES
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.smooth import SmoothFields
from rhytid.pipeline.stretch_buffers import StretchBuffers
from rhytid.pipeline.vectors import VECTOR


class Blend:
    """What blending needs of an asset, on the device."""

    def __init__(self, device: Device, settings: AssetSettings, triangles: int) -> None:
        assert settings.depth is not None
        bins, response = settings.bins, settings.response
        self._device, self._bins, self._triangles = device, bins, triangles
        self._surface = settings.angles == "surface"
        self._merge = np.array([settings.depth, settings.shape.sharpness], np.float32)
        exponents = [response.alpha_d, response.beta_d] if bins.depth_factored else [0.0, 0.0]
        self._exponents = np.array(exponents, np.float32)
        self._directions = device.upload(directions(settings.bins.count).astype(np.float32))
        self._steps = device.upload(quantisation_steps(settings))
        self._layers: dict[str, object] = {
            "LAYERS": bins.count + 1,
            "SAMPLES": bins.samples,
        }
        self._oriented = {"ORIENTED": bins.count if bins.count > 1 else 0}
        self._codes = {
            "CODE": CODES[bins.bits],
            "CODE_BITS": bins.bits,
            "PARTS": len(parts(bins)),
        }

    def weights(self, stretch: StretchBuffers) -> Buffer:
        """Where each triangle stands between the samples, and the depth scale that its maps lack,
        per layer (Alg. 3, lines 6 to 10)."""
        count = self._triangles + 1
        found = self._device.empty(2 * count * (self._bins.count + 1), np.float32)
        self._device.launch(
            "weights", "sample_weights", (count,),
            *self._stretch(stretch), np.float32(self._bins.r_max), self._exponents, found,
            defines={**self._layers, **RESPONSE_DEFINES, **self._oriented},
        )  # fmt: skip
        return found

    def stretches(self, stretch: StretchBuffers) -> Buffer:
        """Log stretch of each triangle and layer: what `stiff_tile` takes in place of weights
        (Alg. 3, lines 6 and 7)."""
        count = self._triangles + 1
        found = self._device.empty(count * (self._bins.count + 1), np.float32)
        self._device.launch(
            "weights", "layer_stretches", (count,), *self._stretch(stretch), found,
            defines={**self._layers, **RESPONSE_DEFINES, **self._oriented},
        )  # fmt: skip
        return found

    def tile(self, maps: BinTile, weights: Buffer) -> Buffer:
        """float32 displacement of one tile, on the device (Alg. 3, lines 11 to 15)."""
        out = self._device.empty(maps.texels, np.float32)
        self._device.launch(
            "blend", "blend", (maps.texels // VECTOR,),
            maps.triangles.firsts, maps.triangles.members, maps.codes,
            weights, self._steps, self._merge, out,
            defines={**self._layers, **self._codes},
        )  # fmt: skip
        return out

    def stiff_tile(self, maps: BinTile, stretches: Buffer) -> Buffer:
        """As `tile`, of a tile whose texels have a stiffness (Alg. 3, lines 8 to 15)."""
        out = self._device.empty(maps.texels, np.float32)
        self._device.launch(
            "blend_stiff", "blend_stiff", (maps.texels // VECTOR,),
            maps.triangles.firsts, maps.triangles.members, maps.stiffness, maps.codes, stretches,
            self._steps, np.float32(self._bins.r_max), self._exponents, self._merge, out,
            defines={**self._layers, **RESPONSE_DEFINES, **self._codes},
        )  # fmt: skip
        return out

    def smooth_tile(self, maps: BinTile, fields: SmoothFields, located: UdimTriangles) -> Buffer:
        """As `tile`, with a stretch of its own for every texel (Alg. 3, lines 2 to 15)."""
        out = self._device.empty(maps.texels, np.float32)
        self._device.launch(
            "blend_smooth", "blend_smooth", (maps.texels // VECTOR,),
            maps.triangles.firsts, maps.triangles.members, maps.codes, self._steps,
            self._directions, np.float32(self._bins.r_max), self._exponents, self._merge,
            *maps.place, *fields.arguments(located),
            fields.neutral, maps.stiffness, out,
            defines={**self._layers, **RESPONSE_DEFINES, **self._oriented, **self._codes},
        )  # fmt: skip
        return out

    def _stretch(self, stretch: StretchBuffers) -> tuple[object, ...]:
        jacobians = stretch.jacobians if self._surface else None
        return (stretch.axes, stretch.logs, jacobians, self._directions)

    def release(self) -> None:
        """Give the memory back."""
        self._directions.release()
        self._steps.release()
