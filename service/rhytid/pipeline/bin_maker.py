"""Draws the precomputed maps of the fast method, tile by tile (section 2.4). Kernels: bins.cl,
tilt.cl.

There are maps of level 0 only: means of maps, blended, are flatter than the mean of the blend.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import count as counter
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.programs import NO_DEFINES
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.painted_maps import Stiffness
from rhytid.pipeline.bins import (
    CODES,
    TILT_SHARE,
    code_limit,
    depth_limits,
    directions,
    drawn_depth_exponents,
    map_argument,
    map_count,
    parts,
    quantisation_steps,
    sample_stretches,
    scale,
    tilt_width,
)
from rhytid.pipeline.cushion import CushionMaker, CushionTile
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import launch_blocks
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.vectors import VECTOR, VectorTriangles
from rhytid.pipeline.work import BLOCK, Square, timed

# Runs the kernel of a map over a square of level 0: (square, into, defines).
_Launch = Callable[..., None]


@dataclass(frozen=True)
class BinTile(BufferGroup):
    """One tile of every precomputed map, and the triangles of its texels.

    codes: (texels / VECTOR, maps, VECTOR), of texels of a row; maps are M samples within parts
    within N + 1 layers, and after the maps of a bin its tilt.
    stiffness: float32 of each texel, or None: 1 throughout.
    place: texels per side of the tile and of its map, row and column of its first texel.
    cushion: the broad layer of wrinkles around the tile; None where there is none.
    """

    triangles: VectorTriangles
    codes: Buffer
    texels: int
    place: tuple[np.int32, np.int32, np.int32, np.int32]
    stiffness: Buffer | None = None
    cushion: CushionTile | None = None

    def read(self, device: Device, maps: int, index: int, bits: int) -> NDArray[np.integer]:
        """(n, n) codes of the map `index` of so many."""
        side, dtype = int(self.place[0]), np.dtype(f"i{bits // 8}")
        codes = device.read(self.codes, (self.texels // VECTOR, maps, VECTOR), dtype)
        found: NDArray[np.integer] = codes[:, index]
        return found.reshape(side, side)

    @property
    def _buffers(self) -> tuple[VectorTriangles | Buffer | CushionTile | None, ...]:
        return (self.triangles, self.codes, self.stiffness, self.cushion)


class BinMaker:
    """Makes tiles of the precomputed maps of one UDIM."""

    def __init__(
        self,
        device: Device,
        elements: UdimElements,
        located: UdimTriangles,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
    ) -> None:
        self._device, self._elements, self._located = device, elements, located
        self._stiffness = stiffness
        self._settings = settings
        steps = quantisation_steps(settings, elements.share_range)
        self._per_step = 1.0 / np.maximum(steps, 1e-30)
        bins = settings.bins
        self._code_defines = {"CODE": CODES[bins.bits], "CODE_LIMIT": code_limit(bins.bits)}

    def tile(self, row: int, column: int, texels: int) -> BinTile:
        """The tile of `texels`² texels from (row, column) on, with all layers and samples."""
        square = (row, column, texels)
        least = BLOCK if self._elements.cushion is None else BLOCK * self._elements.cushion.factor
        pieces = self._elements.work.cut(square, self._elements.bins_pace.most, texels, least)
        if len(pieces) == 1:
            return self._tile(square, self._codes(square))
        bins = self._settings.bins
        codes = self._device.empty(map_count(bins) * texels * texels, f"i{bins.bits // 8}")
        item = map_count(bins) * bins.bits // 8
        for top, left, side in pieces:
            piece = self._codes((top, left, side))
            to = ((top - row) * texels + left - column, texels)
            self._device.copy_square(piece, codes, to, side, item)
            self._device.finish()
            piece.release()
        return self._tile(square, codes)

    def _codes(self, square: Square) -> Buffer:
        """The codes of every map of a square, drawn map by map."""
        bins, texels = self._settings.bins, square[2] ** 2
        codes = self._device.empty(map_count(bins) * texels, f"i{bins.bits // 8}")
        maps = (map_argument(index, map_count(bins)) for index in counter())
        for layer, samples in enumerate(bins.layer_samples):
            for part, sample in product(parts(bins), range(samples)):
                coded = (self._per_step[layer, sample], next(maps), codes)
                self._timed(self._map(layer, part, sample), square, coded, self._code_defines)
            if bins.tilt and layer < bins.count:
                self._tilt(layer, square, next(maps), codes)
        return codes

    def _timed(
        self, launch: _Launch, square: Square, into: tuple[Any, ...], defines: Mapping[str, object]
    ) -> None:
        """Launch one map of a square and wait for it, as one step."""
        pace, work = self._elements.bins_pace, self._elements.work.of(*square)
        timed(self._device, pace, work, partial(launch, square, into, defines))

    def _tile(self, square: Square, codes: Buffer) -> BinTile:
        """The tile of codes, with the triangles and the stiffness of its texels."""
        side, (row, column, texels) = self._settings.resolution, square
        triangles = self._located.texels(side, row, column, texels)
        found = VectorTriangles.of(self._device, triangles, texels * texels)
        triangles.release()
        stiffness = stiffness_of_texels(
            self._device, self._stiffness, self._located.udim, side, row, column, texels
        )
        place = (np.int32(texels), np.int32(side), np.int32(row), np.int32(column))
        return BinTile(found, codes, texels * texels, place, stiffness, self._cushion(square))

    def _cushion(self, square: Square) -> CushionTile | None:
        """The broad layer around a square, None where there is none."""
        if self._elements.cushion is None:
            return None
        return CushionMaker(self._device, self._elements, self._settings).tile(square)

    def _tilt(self, index: int, square: Square, map: NDArray[np.int32], codes: Buffer) -> None:
        """Write codes of the angle at which wrinkles run within their bin, drawn at the largest
        width that they have."""
        scales = _float2(tilt_width(self._settings), 1.0)
        launches = (self._wrinkles(index, scales, 0, s) for s in (TILT_SHARE, -TILT_SHARE))
        up, down = (self._drawn(launch, square) for launch in launches)
        count = square[2] ** 2 // VECTOR
        self._device.launch(
            "tilt", "tilt_codes", (count,), up, down, np.float32(TILT_SHARE), map, codes,
            defines=self._code_defines,
        )  # fmt: skip
        self._device.finish()
        up.release()
        down.release()

    def _drawn(self, launch: _Launch, square: tuple[int, int, int]) -> Buffer:
        """A map as displacement."""
        out = self._device.empty(square[2] ** 2, np.float32)
        self._timed(launch, square, (out,), NO_DEFINES)
        return out

    def _map(self, layer: int, part: int, sample: int) -> _Launch:
        settings, response = self._settings, self._settings.response
        r = float(sample_stretches(settings, layer)[sample])
        exponent, most = drawn_depth_exponents(settings)[layer], depth_limits(settings)[layer]
        depth = scale(response, r, -exponent, most)
        if layer == settings.bins.count:
            return self._pores(_float2(scale(response, r, response.beta_w), depth), part)
        scales = _float2(scale(response, r, response.alpha_w), depth)
        return self._wrinkles(layer, scales, part, r=r)

    def _wrinkles(
        self, index: int, scales: NDArray[np.float32], part: int, tilt: float = 0.0, r: float = 0.0
    ) -> _Launch:
        """Of one bin.  r: log stretch that shares answer to."""
        elements, lists = self._elements, self._elements.wrinkle_lists
        count = self._settings.bins.count
        leaning = np.array([*directions(count)[index], tilt * 2 * count / np.pi, 0.0], np.float32)
        shares = elements.share_arguments(self._settings.response, r)
        return self._launching(
            "draw_wrinkle_bin",
            *elements.line_arguments, *shares, elements.bins, np.int32(index), scales,
            np.int32(part), leaning, lists.offsets, lists.members,
        )  # fmt: skip

    def _pores(self, scales: NDArray[np.float32], part: int) -> _Launch:
        elements, lists = self._elements, self._elements.pore_lists
        return self._launching(
            "draw_pore_layer",
            elements.centres,
            elements.roots,
            scales,
            np.int32(part),
            lists.offsets,
            lists.members,
        )

    def _launching(self, kernel: str, *arguments: Any) -> _Launch:
        def launch(square: Square, into: tuple[Any, ...], defines: Mapping[str, object]) -> None:
            launch_blocks(
                self._device, "bins", kernel, self._settings, self._elements, square, *arguments,
                into=into, defines={**defines, **self._elements.share_defines},
            )  # fmt: skip

        return launch


def _float2(x: float, y: float) -> NDArray[np.float32]:
    return np.array([x, y], np.float32)
