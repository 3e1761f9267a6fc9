"""Draws the broad layer of the wrinkles, coarse, for a frame or as precomputed maps. Kernels:
cushion.cl, owners.cl, quantise.cl; spline.clh brings the layer up.

The maps have no bins. All lines are in each of them, drawn at one of SAMPLES log stretches with
their depth, which is divided out of the codes. A frame blends each sample by the log stretch of its
owner, the line that counts most there: blend.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.bins import (
    CODES,
    EVEN,
    HEADROOM,
    ShareRange,
    code_limit,
    map_argument,
    scale,
)
from rhytid.pipeline.cushion_layer import APRON, COARSE_BLOCK, LEAST_HALF_WIDTH, WIDENED
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK, Square, timed

# Texels a side of what a work-group draws.
_BLOCK = COARSE_BLOCK + 2 * APRON
# Values beyond a coarse map that its buffer has: spline.clh reads a vector at once.
MORE = VECTOR
# How the layers of its maps are called: heights at every sample, the owner of each sample, and
# where along that it is.
CUSHIONS, OWNERS, PLACES = "cushions", "cushion_owners", "cushion_places"
# Log stretches that its maps are drawn at.
SAMPLES = 7
# The programs of the kernels.
_PROGRAMS = {"cushion": "cushion", "cushion_map": "cushion", "cushion_owners": "owners"}
# Draws a square into arrays.
_Draw = Callable[[Square, tuple[Buffer, ...]], None]
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
    side = coarse_side(square[2], _factor(elements))
    out = device.empty(side * side + MORE, np.float32)
    launch_cushion(device, "cushion", elements, settings, square, scales, into=(out,))
    return out


def launch_cushion(
    device: Device,
    kernel: str,
    elements: UdimElements,
    settings: AssetSettings,
    square: Square,
    *arguments: Any,
    into: tuple[Buffer, ...],
) -> None:
    """Run a kernel of cushion.cl or owners.cl over the coarse map around a square.

    arguments: those that this kernel has beside the common ones.  into: of its output.
    """
    cushion = elements.cushion
    assert cushion is not None
    factor, assets = cushion.factor, settings.resolution
    row, column, texels = (at // factor for at in square)
    parts = max(COARSE_BLOCK // device.shape.rows, 1)
    across, down = (
        (at + texels - 1) // COARSE_BLOCK - at // COARSE_BLOCK + 1 for at in (column, row)
    )
    segments, _, *others = elements.line_arguments
    side = coarse_side(square[2], factor)
    place = (row - APRON, column - APRON, side, assets // (factor * COARSE_BLOCK))
    device.launch(
        _PROGRAMS[kernel], kernel, (across * device.shape.lanes, down * parts),
        segments, cushion.sizes, *others, *arguments, cushion.lists.offsets,
        cushion.lists.members, _shape_values(settings),
        np.float32(settings.depth), np.array(place, np.int32), *into,
        group=(device.shape.lanes, 1),
        defines={
            "BLOCK": _BLOCK, "ROWS": _BLOCK // parts, "ITEMS": device.shape.lanes,
            "APRON": APRON, "COARSE_BLOCK": COARSE_BLOCK, "COARSER": factor,
            "LEAST_HALF_WIDTH": f"{LEAST_HALF_WIDTH}f", "WIDENED": f"{WIDENED}f",
            **elements.line_defines, **elements.share_defines,
        },
    )  # fmt: skip


def _factor(elements: UdimElements) -> int:
    assert elements.cushion is not None
    return elements.cushion.factor


def _shape_values(settings: AssetSettings) -> NDArray[np.float32]:
    """The shape argument: no bulge, the sharpness of the layer, one slot, with which a lone line
    keeps its depth."""
    return np.array([0.0, 0.0, settings.shape.cushion_sharpness, 1.0], np.float32)


def last_stretch(settings: AssetSettings) -> float:
    """Log stretch of the last sample of the layer: the limit of log stretch, or what takes depth to
    its own limit, where that is less."""
    response = settings.response
    most = 1.5 * math.log(SCALE_LIMIT)  # where a soft limit is reached
    return min(response.log_stretch_limit, most / max(response.alpha_d, 1e-6))


def cushion_samples(settings: AssetSettings) -> NDArray[np.float64]:
    """(SAMPLES,) log stretch of each sample of the layer, evenly spaced around 0."""
    last = last_stretch(settings)
    return np.linspace(-last, last, SAMPLES)


def cushion_layers(settings: AssetSettings) -> dict[str, tuple[int, ...]]:
    """The layers by name, as `layers` of bins.py has them: the index of the first map of each. Maps
    are in the order of `CushionTile.codes`; owners are none of them. Empty where there is no
    cushion."""
    if settings.shape.cushion == 0.0:
        return {}
    return {CUSHIONS: (0,), PLACES: (SAMPLES,)}


def cushion_steps(settings: AssetSettings, shares: ShareRange = EVEN) -> NDArray[np.float32]:
    """(SAMPLES,) displacement of one code over the depth scale, mesh units.

    Codes go as far as the deepest line does, or as _MEETING lines of full depth that overlap.
    shares: of the graph.
    """
    assert settings.depth is not None
    shape, response = settings.shape, settings.response
    meeting = math.log(_MEETING) / shape.cushion_sharpness
    most = [
        shape.cushion * shares.deepest(response, r) + meeting / _depth_scale(settings, r)
        for r in cushion_samples(settings)
    ]
    step = settings.depth * (1.0 + HEADROOM) / code_limit(settings.bins.bits)
    return (step * np.array(most)).astype(np.float32)


def bytes_a_sample(settings: AssetSettings) -> int:
    """Bytes that a sample of a tile of the layer takes."""
    return (SAMPLES + 1) * settings.bins.bits // 8 + np.dtype(np.int32).itemsize


def _depth_scale(settings: AssetSettings, r: float) -> float:
    return scale(settings.response, r, -settings.response.alpha_d)


@dataclass(frozen=True)
class CushionTile(BufferGroup):
    """The broad layer around a tile, coarse: `side`² samples, row by row.

    owners: int32, the line of the elements that a sample answers by; as many as there are lines
    where it has none.  codes: (samples / VECTOR, SAMPLES + 1, VECTOR), heights at every sample, and
    places along owners from 0 to the largest code.
    """

    side: int
    owners: Buffer
    codes: Buffer

    def read(self, device: Device, index: int, bits: int) -> NDArray[np.integer]:
        """(side, side) codes of one map."""
        shape = (self.side**2 // VECTOR, SAMPLES + 1, VECTOR)
        codes = device.read(self.codes, shape, np.dtype(f"i{bits // 8}"))
        found: NDArray[np.integer] = codes[:, index].reshape(self.side, self.side)
        return found

    def read_owners(self, device: Device) -> NDArray[np.int32]:
        """(side, side) owners."""
        found: NDArray[np.int32] = device.read(self.owners, (self.side, self.side), np.int32)
        return found

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.owners, self.codes)


class CushionMaker:
    """Makes tiles of the precomputed maps of the broad layer of one UDIM."""

    def __init__(self, device: Device, elements: UdimElements, settings: AssetSettings) -> None:
        self._device, self._elements, self._settings = device, elements, settings
        self._factor = _factor(elements)
        self._steps = cushion_steps(settings, elements.share_range)
        bits = settings.bins.bits
        self._limit = code_limit(bits)
        self._defines: dict[str, object] = {"CODE": CODES[bits], "CODE_LIMIT": self._limit}

    def tile(self, square: Square) -> CushionTile:
        """The layer around a square (row, column, texels per side) of level 0."""
        side = coarse_side(square[2], self._factor)
        count, bits = (SAMPLES + 1) * side**2, self._settings.bins.bits
        codes = self._device.empty(count, f"i{bits // 8}")
        for index, r in enumerate(cushion_samples(self._settings)):
            (heights,) = self._in_pieces(square, self._map(float(r)), 1)
            code = self._steps[index] * _depth_scale(self._settings, float(r))
            self._quantise(heights, side, 1.0 / max(code, 1e-30), index, codes)
        owners, places = self._in_pieces(square, self._owners(), 2)
        self._quantise(places, side, self._limit, SAMPLES, codes)
        return CushionTile(side, owners, codes)

    def _quantise(
        self, values: Buffer, side: int, per_step: float, index: int, codes: Buffer
    ) -> None:
        """Write values of the samples as codes of a map, and release them."""
        self._device.launch(
            "quantise", "quantise", (side**2 // VECTOR,),
            values, np.float32(per_step), map_argument(index, SAMPLES + 1), codes,
            defines=self._defines,
        )  # fmt: skip
        self._device.finish()
        values.release()

    def _map(self, r: float) -> _Draw:
        """Draws all lines at one log stretch."""
        response = self._settings.response
        scales = (scale(response, r, response.alpha_w), _depth_scale(self._settings, r))
        return self._launched("cushion_map", r, np.array(scales, np.float32))

    def _owners(self) -> _Draw:
        """Finds owners and places, by the weights that shares make at the second sample."""
        r = float(cushion_samples(self._settings)[1])
        return self._launched("cushion_owners", r, np.int32(self._elements.wrinkles))

    def _launched(self, kernel: str, r: float, given: Any) -> _Draw:
        """Runs a kernel over a square, with the shares of lines at a log stretch."""
        elements, settings = self._elements, self._settings
        cushion = settings.shape.cushion
        shares = elements.share_arguments(settings.response, r, (1.0 - cushion) / cushion)
        return lambda square, into: launch_cushion(
            self._device, kernel, elements, settings, square, *shares, given, into=into
        )

    def _in_pieces(self, square: Square, draw: _Draw, count: int) -> tuple[Buffer, ...]:
        """Arrays of the samples around a square, each of 4 bytes, that `draw` writes, a piece at a
        time: whole blocks of samples."""
        elements, least = self._elements, BLOCK * self._factor
        pieces = elements.work.cut(square, elements.cushion_pace.most, square[2], least)
        whole = self._room(square, count)
        if len(pieces) == 1:
            self._timed(draw, square, whole)
            return whole
        side = coarse_side(square[2], self._factor)
        for piece in pieces:
            parts = self._room(piece, count)
            self._timed(draw, piece, parts)
            down, across = ((piece[i] - square[i]) // self._factor for i in (0, 1))
            part_side = coarse_side(piece[2], self._factor)
            for part, out in zip(parts, whole, strict=True):
                self._device.copy_square(part, out, (down * side + across, side), part_side, 4)
            self._device.finish()
            for part in parts:
                part.release()
        return whole

    def _timed(self, draw: _Draw, square: Square, into: tuple[Buffer, ...]) -> None:
        pace, work = self._elements.cushion_pace, self._elements.work.of(*square)
        timed(self._device, pace, work, partial(draw, square, into))

    def _room(self, square: Square, count: int) -> tuple[Buffer, ...]:
        side = coarse_side(square[2], self._factor)
        return tuple(self._device.empty(side**2, np.float32) for _ in range(count))
