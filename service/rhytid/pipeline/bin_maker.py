"""Draws the precomputed maps of the fast method, tile by tile (section 2.4). Kernels: bins.cl,
tilt.cl.

There are maps of level 0 only: means of maps, blended, are flatter than the mean of the blend.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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

# Of the work that a step may have, what maps share that run in one step: about 3 ms.
_STEP_SHARE = 1 / 16

# Runs the kernel of a map over a square of level 0: (square, into).
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
        launches = []
        for layer, samples in enumerate(bins.layer_samples):
            for part, sample in product(parts(bins), range(samples)):
                coded = (self._per_step[layer, sample], next(maps), codes)
                launches.append(partial(self._map(layer, part, sample), square, coded))
            if bins.tilt and layer < bins.count:
                launches.append(partial(self._tilt(layer), square, (next(maps), codes)))
        self._in_steps(launches, self._elements.work.of(*square))
        return codes

    def _in_steps(self, launches: Sequence[Callable[[], None]], work: float) -> None:
        """Run launches of so much work each, and wait for them. Others use the device between
        steps; a step costs a processor half a millisecond, and has several small launches."""
        pace, done = self._elements.bins_pace, 0
        while done < len(launches):
            count = max(1, min(int(_STEP_SHARE * pace.most / max(work, 1.0)), len(launches) - done))
            step = launches[done : done + count]
            timed(self._device, pace, count * work, partial(_each, step))
            done += count

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

    def _tilt(self, index: int) -> _Launch:
        """Of the angle at which wrinkles run within their bin, drawn at the largest width that they
        have."""
        bins, bulging = self._settings.bins, self._settings.shape.wrinkle_bulge > 1.0
        theta, per_radian = directions(bins.count)[index], TILT_SHARE * 2 * bins.count / np.pi
        tilt = np.array([*theta, per_radian, TILT_SHARE], np.float32)
        return self._launching(
            "tilt", "draw_tilts",
            *self._of_bin(index, _float2(tilt_width(self._settings), 1.0), 0.0), tilt,
            *self._lists, defines={"BULGING": int(bulging)}, maps=2 if bulging else 1,
        )  # fmt: skip

    def _map(self, layer: int, part: int, sample: int) -> _Launch:
        settings, response = self._settings, self._settings.response
        r = float(sample_stretches(settings, layer)[sample])
        exponent, most = drawn_depth_exponents(settings)[layer], depth_limits(settings)[layer]
        depth = scale(response, r, -exponent, most)
        if layer == settings.bins.count:
            return self._pores(_float2(scale(response, r, response.beta_w), depth), part)
        scales = _float2(scale(response, r, response.alpha_w), depth)
        return self._launching(
            "bins", "draw_wrinkle_bin",
            *self._of_bin(layer, scales, r), np.int32(part), *self._lists,
        )  # fmt: skip

    def _of_bin(self, index: int, scales: NDArray[np.float32], r: float) -> tuple[Any, ...]:
        """The lines of a bin as arguments.  r: log stretch that shares answer to."""
        elements = self._elements
        shares = elements.share_arguments(self._settings.response, r)
        return (*elements.line_arguments, *shares, elements.bins, np.int32(index), scales)

    @property
    def _lists(self) -> tuple[Buffer, Buffer]:
        lists = self._elements.wrinkle_lists
        return lists.offsets, lists.members

    def _pores(self, scales: NDArray[np.float32], part: int) -> _Launch:
        elements, lists = self._elements, self._elements.pore_lists
        return self._launching(
            "bins", "draw_pore_layer",
            elements.centres, elements.roots, scales, np.int32(part), lists.offsets, lists.members,
        )  # fmt: skip

    def _launching(
        self,
        program: str,
        kernel: str,
        *arguments: Any,
        defines: Mapping[str, object] = NO_DEFINES,
        maps: int = 1,
    ) -> _Launch:
        every = {**self._code_defines, **self._elements.share_defines, **defines}

        def launch(square: Square, into: tuple[Any, ...]) -> None:
            launch_blocks(
                self._device, program, kernel, self._settings, self._elements, square, *arguments,
                into=into, defines=every, maps=maps,
            )  # fmt: skip

        return launch


def _each(launches: Sequence[Callable[[], None]]) -> None:
    for launch in launches:
        launch()


def _float2(x: float, y: float) -> NDArray[np.float32]:
    return np.array([x, y], np.float32)
