"""Precomputed maps of the broad layer: bins of its own, coarse, merged as its lines meet (2.4).
Kernels: cushion.cl, quantise.cl, tilt.cl."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import count as counter

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import (
    CODES,
    code_limit,
    directions,
    drawn_depth_exponents,
    quantisation_steps,
    sample_stretches,
    scale,
)
from rhytid.pipeline.cushion import coarse_side, launch_cushion
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.vectors import VECTOR

# Lines of full depth that may meet at a sample before a code of it saturates.
_MEETING = 8


def cushion_settings(settings: AssetSettings) -> AssetSettings:
    """Those that the maps of the layer are made and blended with: heights of one sign, which meet
    across bins as within."""
    sharpness = settings.shape.cushion_sharpness
    shape = replace(settings.shape, sharpness=sharpness, slots=1, grain=0.0)
    return replace(settings, bins=replace(settings.bins, merge="signed"), shape=shape)


def cushion_map_count(settings: AssetSettings) -> int:
    """Maps of a tile of the layer: samples and tilt of every bin, and no pores."""
    bins = settings.bins
    return bins.count * (bins.samples + bins.tilt)


def cushion_steps(settings: AssetSettings) -> NDArray[np.float32]:
    """As `quantisation_steps`, for the depth that the layer takes and what meets in it."""
    steps: NDArray[np.float32] = quantisation_steps(settings) * np.float32(range_of_codes(settings))
    return steps


def range_of_codes(settings: AssetSettings) -> float:
    """How many times as large a code of the layer is as one of the narrow layer."""
    shape = settings.shape
    return shape.cushion + math.log(_MEETING) / shape.cushion_sharpness


class CushionBins:
    """Draws them for one UDIM."""

    def __init__(
        self, device: Device, elements: UdimElements, settings: AssetSettings, tilt_share: float
    ) -> None:
        self._device, self._elements, self._settings = device, elements, settings
        self._per_step = 1.0 / np.maximum(cushion_steps(settings), 1e-30)
        self._tilt_share = tilt_share
        bins = settings.bins
        self._defines: dict[str, object] = {
            "CODE": CODES[bins.bits],
            "CODE_LIMIT": code_limit(bins.bits),
            "MAPS": cushion_map_count(settings),
        }

    def codes(self, square: tuple[int, int, int]) -> Buffer:
        """(samples / VECTOR, maps, VECTOR) around a square (row, column, texels a side) of level 0,
        in squares of samples: of each bin the maps of its samples, then its tilt."""
        bins, cushion = self._settings.bins, self._elements.cushion
        assert cushion is not None
        side = coarse_side(square[2], cushion.factor)
        size, self._defines["SQUARES"] = side**2, side
        codes = self._device.empty(cushion_map_count(self._settings) * size, f"i{bins.bits // 8}")
        at = counter()
        for index in range(bins.count):
            for sample in range(bins.samples):
                heights = self._map(index, sample, square)
                per_step = self._per_step[index, sample]
                self._put("quantise", "quantise", (heights,), per_step, next(at), codes)
            if bins.tilt:
                heights_of_both = self._tilts(index, square)
                share = np.float32(self._tilt_share)
                self._put("tilt", "tilt_codes", heights_of_both, share, next(at), codes)
        return codes

    def _put(
        self, program: str, kernel: str, heights: tuple[Buffer, ...], factor: np.float32, at: int,
        codes: Buffer,
    ) -> None:  # fmt: skip
        count = codes.nbytes // (int(str(self._defines["MAPS"])) * self._settings.bins.bits // 8)
        self._device.launch(
            program, kernel, (count // VECTOR,), *heights, factor, np.int32(at), codes,
            defines=self._defines,
        )  # fmt: skip
        self._device.finish()
        for buffer in heights:
            buffer.release()

    def _map(self, index: int, sample: int, square: tuple[int, int, int]) -> Buffer:
        settings = self._settings
        r = float(sample_stretches(settings)[sample])
        response = settings.response
        depth = scale(response, r, -drawn_depth_exponents(settings)[index])
        return self._draw(index, (scale(response, r, response.alpha_w), depth), 0.0, square)

    def _tilts(self, index: int, square: tuple[int, int, int]) -> tuple[Buffer, ...]:
        response = self._settings.response
        wide = (scale(response, self._settings.last_sample, response.alpha_w), 1.0)
        shares = (self._tilt_share, -self._tilt_share)
        return tuple(self._draw(index, wide, share, square) for share in shares)

    def _draw(
        self, index: int, scales: tuple[float, float], tilt: float, square: tuple[int, int, int]
    ) -> Buffer:
        count = self._settings.bins.count
        leaning = [*directions(count)[index], tilt * 2 * count / np.pi, 0.0]
        return launch_cushion(
            self._device, "cushion_bin", self._elements, self._settings, square,
            self._elements.bins, np.int32(index), np.array(scales, np.float32),
            np.array(leaning, np.float32),
        )  # fmt: skip
