"""Draws the broad layer of the wrinkles, coarse, for a frame or as precomputed maps. Kernels:
cushion.cl, cushion_maps.cl, owners.cl, vectors.cl; spline.clh brings the layer up.

The maps have no bins. All lines are in each of them, drawn at one of SAMPLES log stretches with
their depth, which is divided out of the codes. A frame blends each sample by the log stretch of its
owner, the line that counts most there: blend.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.launches import sums_of_map
from rhytid.device.programs import NO_DEFINES
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
from rhytid.pipeline.elements import DrawnStretch, UdimElements
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK, Square, timed

# Texels a side of what a work-group draws.
_BLOCK = COARSE_BLOCK + 2 * APRON
# Values beyond a coarse map that its buffer has: spline.clh reads a vector at once.
_MORE = VECTOR
# How the layers of its maps are called: heights at every sample, the owner of each sample, and
# where along that it is.
CUSHIONS, OWNERS, PLACES = "cushions", "cushion_owners", "cushion_places"
# Log stretches that its maps are drawn at.
SAMPLES = 7
# The programs of the kernels.
_PROGRAMS = {"cushion": "cushion", "cushion_maps": "cushion_maps", "cushion_owners": "owners"}
# Sums of as many maps take the owners of samples, where they are drawn with the maps.
_OWNER_SUMS = 3
# Lines of full depth that may overlap at a sample before its code saturates.
_MEETING = 8


def coarse_side(side: int, factor: int) -> int:
    """Samples a side of the coarse map of `side` texels, with its apron."""
    return side // factor + 2 * APRON


def _values(side: int) -> int:
    """Numbers that a coarse map takes: its samples, and _MORE behind them."""
    return side**2 + _MORE


def draw_cushion(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: Buffer,
    square: tuple[int, int, int],
) -> Buffer:  # fmt: skip
    """Draw the broad layer around a square (row, column, texels per side) of level 0, all multiples
    of BLOCK. Returns coarse_side² samples in mesh units, with _MORE values behind them.

    scales: (σ_w, σ_d) of wrinkles.
    """
    side = coarse_side(square[2], _factor(elements))
    out = device.empty(_values(side), np.float32)
    launch_cushion(device, "cushion", elements, settings, square, scales, into=(out,))
    return out


def launch_cushion(
    device: Device,
    kernel: str,
    elements: UdimElements,
    settings: AssetSettings,
    square: Square,
    *arguments: Any,
    into: tuple[Any, ...],
    defines: Mapping[str, object] = NO_DEFINES,
) -> None:
    """Run a kernel of cushion.cl, cushion_maps.cl or owners.cl over the coarse map around a square.

    arguments: those that this kernel has beside the common ones.  into: of its output.
    """
    cushion = elements.cushion
    assert cushion is not None
    factor, assets = cushion.factor, settings.resolution
    row, column, texels = (at // factor for at in square)
    rows = _rows_of_part(device.shape.rows)
    parts = _BLOCK // rows
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
        np.float32(settings.depth), np.array(place, np.int32), np.float32(1.0 / factor), *into,
        group=(device.shape.lanes, 1),
        defines={
            "BLOCK": _BLOCK, "ROWS": rows, "ITEMS": device.shape.lanes,
            "APRON": APRON, "COARSE_BLOCK": COARSE_BLOCK, "BULGING": 0,
            "LEAST_HALF_WIDTH": f"{LEAST_HALF_WIDTH}f", "WIDENED": f"{WIDENED}f",
            **elements.line_defines, **elements.share_defines, **defines,
        },
    )  # fmt: skip


def _rows_of_part(rows: int) -> int:
    """Rows that a work-group draws, by those of a block that it draws of other maps."""
    return _BLOCK // max(COARSE_BLOCK // rows, 1)


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
    where it has none; the complement in the first of VECTOR samples without a height.
    codes: (samples / VECTOR, SAMPLES + 1, VECTOR), heights at every sample, and places along owners
    from 0 to the largest code.
    """

    side: int
    owners: Buffer
    codes: Buffer

    @property
    def values(self) -> int:
        """Numbers that its heights take, where they are side by side with those of others."""
        return _values(self.side)

    def read(self, device: Device, index: int, bits: int) -> NDArray[np.integer]:
        """(side, side) codes of one map."""
        shape = (self.side**2 // VECTOR, SAMPLES + 1, VECTOR)
        codes = device.read(self.codes, shape, np.dtype(f"i{bits // 8}"))
        found: NDArray[np.integer] = codes[:, index].reshape(self.side, self.side)
        return found

    def read_owners(self, device: Device) -> NDArray[np.int32]:
        """(side, side) owners."""
        return self.read_marked(device)[0]

    def read_marked(self, device: Device) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """(side, side) owners, and where the mark of clear samples is, the first of a vector."""
        found: NDArray[np.int32] = device.read(self.owners, (self.side, self.side), np.int32)
        marked = found < 0
        return np.where(marked, ~found, found), marked

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
        side, bits = coarse_side(square[2], self._factor), self._settings.bins.bits
        owners = self._device.empty(side**2, np.int32)
        codes = self._device.empty((SAMPLES + 1) * side**2, f"i{bits // 8}")
        shape = self._device.shape
        at_once = self._device.maps_at_once(sums_of_map(_BLOCK, _rows_of_part(shape.rows)))
        most = at_once - _OWNER_SUMS if shape.lanes == 1 and self._elements.bent else 0
        if most > 0:
            self._draw_maps(square, range(min(most, SAMPLES)), codes, owners)
        else:
            self._draw_owners(square, owners, codes)
        for first in range(max(most, 0), SAMPLES, at_once):
            self._draw_maps(square, range(first, min(first + at_once, SAMPLES)), codes)
        quads = np.array([SAMPLES + 1, SAMPLES], np.int32) * (bits // 8)
        self._device.launch("vectors", "clear_samples", (side**2 // VECTOR,), codes, quads, owners)
        return CushionTile(side, owners, codes)

    def _draw_maps(
        self, square: Square, samples: range, codes: Buffer, owners: Buffer | None = None
    ) -> None:
        """All lines at some of the samples; owners with them, where lines are sixteen at once."""
        defines: dict[str, object] = {**self._defines, "STRETCHES": len(samples)}
        drawn = [self._stretch(index) for index in samples]
        into: tuple[Any, ...] = (map_argument(samples.start, SAMPLES + 1), codes)
        if owners is not None:
            defines["OWNING"] = 1
            drawn.append(DrawnStretch(self._owning_stretch, 1.0, 1.0, 1.0))
            into = (np.int32(self._elements.wrinkles), owners, self._places, *into)
        response = self._settings.response
        stretches = self._elements.stretches(self._device, response, drawn, self._narrow)
        self._in_pieces("cushion_maps", square, stretches, into, defines, len(drawn))
        stretches[-1].release()

    def _stretch(self, index: int) -> DrawnStretch:
        response, r = self._settings.response, float(cushion_samples(self._settings)[index])
        depth = _depth_scale(self._settings, r)
        per_step = 1.0 / max(self._steps[index] * depth, 1e-30)
        return DrawnStretch(r, scale(response, r, response.alpha_w), depth, per_step)

    def _draw_owners(self, square: Square, owners: Buffer, codes: Buffer) -> None:
        """Owners and places alone."""
        elements, response = self._elements, self._settings.response
        shares = elements.share_arguments(response, self._owning_stretch, self._narrow)
        into = (owners, self._places, codes)
        given = (*shares, np.int32(elements.wrinkles))
        self._in_pieces("cushion_owners", square, given, into, self._defines, 1)

    @property
    def _owning_stretch(self) -> float:
        """The log stretch by whose weights lines own samples, where they have shares: that of the
        second sample."""
        return float(cushion_samples(self._settings)[1])

    @property
    def _places(self) -> NDArray[np.int32]:
        """Which map has places along owners."""
        return map_argument(SAMPLES, SAMPLES + 1)

    @property
    def _narrow(self) -> float:
        """Weights of the narrow layer over those of the broad one."""
        cushion = self._settings.shape.cushion
        return (1.0 - cushion) / cushion

    def _in_pieces(
        self,
        kernel: str,
        square: Square,
        arguments: tuple[Any, ...],
        into: tuple[Any, ...],
        defines: Mapping[str, object],
        maps: int,
    ) -> None:
        """Draw so many maps of the samples around a square, a piece of it at a time: whole blocks
        of samples."""
        elements, factor = self._elements, self._factor
        pace, side = elements.cushion_pace, coarse_side(square[2], factor)
        for piece in elements.work.cut(square, pace.most / maps, square[2], BLOCK * factor):
            down, across = ((piece[i] - square[i]) // factor for i in (0, 1))
            target = np.array((down * side + across, side), np.int32)
            draw = partial(
                launch_cushion, self._device, kernel, elements, self._settings, piece, *arguments,
                into=(target, *into), defines=defines,
            )  # fmt: skip
            timed(self._device, pace, maps * elements.work.of(*piece), draw)
