"""Draws the broad layer of the wrinkles, coarse, for a frame or as precomputed maps: bins of its
own, merged as its lines are (section 2.4). Kernels: cushion.cl, quantise.cl; spline.clh brings the
layer up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import (
    CODES,
    EVEN,
    ShareRange,
    code_limit,
    drawn_depth_exponents,
    map_argument,
    quantisation_steps,
    sample_stretches,
    scale,
)
from rhytid.pipeline.cushion_layer import APRON, COARSE_BLOCK, LEAST_HALF_WIDTH, WIDENED
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.vectors import VECTOR, squares
from rhytid.pipeline.work import BLOCK, Square

# Texels a side of what a work-group draws.
_BLOCK = COARSE_BLOCK + 2 * APRON
# Values beyond a coarse map that its buffer has: spline.clh reads a vector at once.
MORE = 8
# How the layers of its maps are called.
CUSHIONS = "cushions"
# Lines of full depth that may overlap at a sample before its code saturates.
_MEETING = 8


def coarse_side(side: int, factor: int) -> int:
    """Samples a side of the coarse map of `side` texels, with its apron."""
    return side // factor + 2 * APRON


def draw_cushion(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: Buffer,
    square: tuple[int, int, int],
) -> Buffer:  # fmt: skip
    """Draw the broad layer around a square (row, column, texels per side) of level 0, all multiples
    of BLOCK. Returns coarse_side² samples in mesh units, with MORE values behind them.

    scales: (σ_w, σ_d) of wrinkles.
    """
    return launch_cushion(device, "cushion", elements, settings, square, scales)


def launch_cushion(
    device: Device,
    kernel: str,
    elements: UdimElements,
    settings: AssetSettings,
    square: tuple[int, int, int],
    *arguments: Any,
    defines: Mapping[str, object] | None = None,
) -> Buffer:
    """Run a kernel of cushion.cl over the coarse map around a square.

    arguments: those that this kernel has beside the common ones.
    """
    cushion = elements.cushion
    assert cushion is not None
    factor, assets = cushion.factor, settings.resolution
    row, column, texels = (at // factor for at in square)
    side = coarse_side(square[2], factor)
    out = device.empty(side * side + MORE, np.float32)
    parts = max(COARSE_BLOCK // device.shape.rows, 1)
    across, down = (
        (at + texels - 1) // COARSE_BLOCK - at // COARSE_BLOCK + 1 for at in (column, row)
    )
    segments, _, *others = elements.line_arguments
    place = (row - APRON, column - APRON, side, assets // (factor * COARSE_BLOCK))
    device.launch(
        "cushion", kernel, (across * device.shape.lanes, down * parts),
        segments, cushion.sizes, *others, *arguments, cushion.lists.offsets,
        cushion.lists.members, _shape_values(settings),
        np.float32(settings.depth), np.array(place, np.int32), out,
        group=(device.shape.lanes, 1),
        defines={
            "BLOCK": _BLOCK, "ROWS": _BLOCK // parts, "ITEMS": device.shape.lanes,
            "APRON": APRON, "COARSE_BLOCK": COARSE_BLOCK, "COARSER": factor,
            "LEAST_HALF_WIDTH": f"{LEAST_HALF_WIDTH}f", "WIDENED": f"{WIDENED}f",
            **elements.line_defines, **elements.share_defines, **(defines or {}),
        },
    )  # fmt: skip
    return out


def _shape_values(settings: AssetSettings) -> NDArray[np.float32]:
    """The shape argument: no bulge, the sharpness of the layer, one slot, with which a lone line
    keeps its depth."""
    return np.array([0.0, 0.0, settings.shape.cushion_sharpness, 1.0], np.float32)


def cushion_settings(settings: AssetSettings) -> AssetSettings:
    """The settings that maps of the layer are made and blended with: heights of one sign, merged
    across bins as they are within a bin."""
    sharpness = settings.shape.cushion_sharpness
    shape = replace(settings.shape, sharpness=sharpness, slots=1, grain=0.0, undulation=0.0)
    return replace(settings, bins=replace(settings.bins, merge="signed"), shape=shape)


def cushion_map_count(settings: AssetSettings) -> int:
    """How many maps a tile of the layer has: the samples of every bin, without tilts and pores.

    Where soft lines lie over one another a tilt is the mean of many: blends are closer to `redraw`
    without (the smile of a real face at r_max 0.3: 7.1 % for 7.6 %).
    """
    bins = settings.bins
    return bins.count * bins.samples


def cushion_layers(settings: AssetSettings) -> dict[str, tuple[int, ...]]:
    """The layers by name, as `layers` of bins.py has them: the index of the first map of every bin,
    in the order of `CushionBins.codes`. Empty where there is no cushion."""
    bins = settings.bins
    if settings.shape.cushion == 0.0:
        return {}
    return {CUSHIONS: tuple(range(0, cushion_map_count(settings), bins.samples))}


def cushion_steps(settings: AssetSettings, shares: ShareRange = EVEN) -> NDArray[np.float32]:
    """`quantisation_steps` of the layer, from its depth and the number of lines that overlap in
    it."""
    range_ = np.float32(range_of_codes(settings))
    steps: NDArray[np.float32] = quantisation_steps(settings, shares) * range_
    return steps


def range_of_codes(settings: AssetSettings) -> float:
    """The size of a code of the layer over that of a code of the narrow layer."""
    shape = settings.shape
    return shape.cushion + math.log(_MEETING) / shape.cushion_sharpness


class CushionBins:
    """Draws the precomputed maps of the broad layer of one UDIM."""

    def __init__(self, device: Device, elements: UdimElements, settings: AssetSettings) -> None:
        self._device, self._elements, self._settings = device, elements, settings
        assert elements.cushion is not None
        self._factor = elements.cushion.factor
        self._per_step = 1.0 / np.maximum(cushion_steps(settings, elements.share_range), 1e-30)
        bins = settings.bins
        self._defines: dict[str, object] = {
            "CODE": CODES[bins.bits],
            "CODE_LIMIT": code_limit(bins.bits),
        }

    def codes(self, square: tuple[int, int, int]) -> Buffer:
        """Codes (coarse samples / VECTOR, maps, VECTOR) around a square (row, column, texels per
        side) of level 0. Vectors are squares of samples; maps are the samples of bin after bin."""
        bins = self._settings.bins
        side = coarse_side(square[2], self._factor)
        maps = cushion_map_count(self._settings)
        codes = self._device.empty(maps * side**2, f"i{bins.bits // 8}")
        for at, (index, sample) in enumerate(product(range(bins.count), range(bins.samples))):
            heights = self._map(index, sample, square)
            self._device.launch(
                "quantise", "quantise", (side**2 // VECTOR,),
                heights, self._per_step[index, sample], map_argument(at, maps), codes,
                defines={**self._defines, **squares(side)},
            )  # fmt: skip
            self._device.finish()
            heights.release()
        return codes

    def _map(self, index: int, sample: int, square: tuple[int, int, int]) -> Buffer:
        settings, response = self._settings, self._settings.response
        r = float(sample_stretches(settings)[sample])
        depth = scale(response, r, -drawn_depth_exponents(settings)[index])
        scales = np.array([scale(response, r, response.alpha_w), depth], np.float32)
        pieces = self._pieces(square)
        if len(pieces) == 1:
            return self._drawn(square, index, scales, r)
        side = coarse_side(square[2], self._factor)
        heights = self._device.empty(side * side + MORE, np.float32)
        for piece in pieces:
            part = self._drawn(piece, index, scales, r)
            down, across = ((piece[i] - square[i]) // self._factor for i in (0, 1))
            part_side = coarse_side(piece[2], self._factor)
            self._device.copy_square(part, heights, (down * side + across, side), part_side, 4)
            self._device.finish()
            part.release()
        return heights

    def _pieces(self, square: Square) -> list[Square]:
        """The parts of a square that are drawn at a time: whole blocks of samples."""
        elements, least = self._elements, BLOCK * self._factor
        return elements.work.cut(square, elements.bins_pace.most, square[2], least)

    def _drawn(self, square: Square, index: int, scales: NDArray[np.float32], r: float) -> Buffer:
        shares = self._elements.share_arguments(self._settings.response, r)
        return launch_cushion(
            self._device, "cushion_bin", self._elements, self._settings, square,
            *shares, self._elements.bins, np.int32(index), scales,
        )  # fmt: skip
