"""Draws the precomputed maps of the fast method, tile by tile (section 2.4). Kernels: bins.cl,
pore_layer.cl, vectors.cl.

There are maps of level 0 only: means of maps, blended, are flatter than the mean of the blend.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.launches import sums_of_map
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.painted_maps import Stiffness
from rhytid.pipeline.bins import (
    CODES,
    TILT_SHARE,
    ShareRange,
    code_limit,
    depth_limits,
    directions,
    drawn_depth_exponents,
    map_count,
    parts,
    quantisation_steps,
    sample_stretches,
    scale,
    tilt_width,
)
from rhytid.pipeline.cushion import CushionMaker, CushionTile
from rhytid.pipeline.elements import DrawnStretch, UdimElements
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import launch_blocks
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.vectors import VECTOR, VectorTriangles
from rhytid.pipeline.work import BLOCK, Square, timed

# Of the work that a step may have, what maps share that run in one step: about 3 ms.
_STEP_SHARE = 1 / 16

_Launch = Callable[[], None]
# Drawings of a bin that its tilt is made of.
_TILT_DRAWINGS = 2


@dataclass(frozen=True)
class _Run:
    """What one launch draws: some samples of a layer, and the tilt of the bin where it is `tilted`.

    share: a work-group draws the rows of a block over this.
    """

    layer: int
    samples: range
    tilted: bool
    share: int = 1

    @property
    def drawings(self) -> int:
        """Drawings that have sums of their own."""
        return len(self.samples) + _TILT_DRAWINGS * self.tilted

    @property
    def maps(self) -> int:
        """Maps that are made."""
        return len(self.samples) + self.tilted


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
        bins = settings.bins
        self._code_defines = {"CODE": CODES[bins.bits], "CODE_LIMIT": code_limit(bins.bits)}
        self._runs = [run for layer in range(bins.count + 1) for run in self._runs_of(layer)]

    def tile(self, row: int, column: int, texels: int) -> BinTile:
        """The tile of `texels`² texels from (row, column) on, with all layers and samples."""
        square = (row, column, texels)
        least = BLOCK if self._elements.cushion is None else BLOCK * self._elements.cushion.factor
        maps = max(run.maps for run in self._runs)
        pieces = self._elements.work.cut(
            square, self._elements.bins_pace.most / maps, texels, least
        )
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
        """The codes of every map of a square, as many maps at once as a work-group has memory
        for."""
        bins = self._settings.bins
        codes = self._device.empty(map_count(bins) * square[2] ** 2, f"i{bins.bits // 8}")
        drawn = [(run.maps, partial(self._launch, run, square, codes)) for run in self._runs]
        self._in_steps(drawn, self._elements.work.of(*square))
        return codes

    def _runs_of(self, layer: int) -> list[_Run]:
        """Which maps of a layer are drawn at once: all; or its tilt apart from the samples, and
        these in as many runs as it takes."""
        bins, device = self._settings.bins, self._device
        samples, tilted = bins.layer_samples[layer], bins.tilt and layer < bins.count
        rows = min(device.shape.rows, BLOCK)
        at_once = device.maps_at_once(sums_of_map(BLOCK, rows) * (1 + self._bulging(layer)))
        whole = _Run(layer, range(samples), tilted)
        if whole.drawings <= at_once:
            return [whole]
        most = range(samples)
        runs = [_Run(layer, most[at : at + at_once], False) for at in most[::at_once]]
        share = 2 if self._bulging(layer) and at_once < _TILT_DRAWINGS else 1
        return [*runs, _Run(layer, range(0), True, share)] if tilted else runs

    def _bulging(self, layer: int) -> bool:
        """Whether elements of a layer have bulges, or maps for them."""
        shape, bins = self._settings.shape, self._settings.bins
        bulge = shape.wrinkle_bulge if layer < bins.count else shape.pore_bulge
        return bulge > 1.0 or len(parts(bins)) > 1

    def _in_steps(self, drawn: Sequence[tuple[int, _Launch]], work: float) -> None:
        """Run launches, each of so many maps of so much work, and wait for them. Others use the
        device between steps; a step costs a processor half a millisecond, and has several small
        launches."""
        pace, maps = self._elements.bins_pace, 0
        waiting: list[_Launch] = []
        for count, launch in drawn:
            if waiting and (maps + count) * work > _STEP_SHARE * pace.most:
                timed(self._device, pace, maps * work, partial(_each, waiting))
                waiting, maps = [], 0
            waiting, maps = [*waiting, launch], maps + count
        timed(self._device, pace, maps * work, partial(_each, waiting))

    def _tile(self, square: Square, codes: Buffer) -> BinTile:
        """The tile of codes, with the triangles and the stiffness of its texels."""
        side, (row, column, texels) = self._settings.resolution, square
        found = self._device.make_in_step(partial(self._triangles, square))
        stiffness = stiffness_of_texels(
            self._device, self._stiffness, self._located.udim, side, row, column, texels
        )
        place = (np.int32(texels), np.int32(side), np.int32(row), np.int32(column))
        cushion = self._cushion(square)
        self._mark_clear(found, codes, texels, cushion)
        return BinTile(found, codes, texels * texels, place, stiffness, cushion)

    def _mark_clear(
        self, triangles: VectorTriangles, codes: Buffer, texels: int, cushion: CushionTile | None
    ) -> None:
        """Mark the clear vectors among those of a tile of `texels`² texels."""
        bins, layer = self._settings.bins, self._elements.cushion
        self._device.launch(
            "vectors", "clear_vectors", (texels * texels // VECTOR,),
            codes, np.int32(map_count(bins) * bins.bits // 8), self._located.none,
            None if cushion is None else cushion.owners, np.int32(texels),
            np.int32(1 if layer is None else layer.factor), triangles.firsts, triangles.members,
        )  # fmt: skip

    def _triangles(self, square: Square) -> VectorTriangles:
        """The triangles of the texels of a square, in a task of the device."""
        triangles = self._located.texels(self._settings.resolution, *square)
        found = VectorTriangles.of(self._device, triangles, square[2] ** 2)
        triangles.release()
        return found

    def _cushion(self, square: Square) -> CushionTile | None:
        """The broad layer around a square, None where there is none."""
        if self._elements.cushion is None:
            return None
        return CushionMaker(self._device, self._elements, self._settings).tile(square)

    def _launch(self, run: _Run, square: Square, codes: Buffer) -> None:
        """Draw the maps of a run, in a task of the device."""
        elements, settings, bins = self._elements, self._settings, self._settings.bins
        drawn = _drawn(settings, elements.share_range, run)
        stretches = elements.stretches(self._device, settings.response, drawn)
        if run.layer < bins.count:
            kernels, lists = ("bins", "draw_wrinkle_bin"), elements.wrinkle_lists
            given = (*elements.line_arguments, *stretches, elements.bins, np.int32(run.layer))
            given = (*given, self._tilt(run.layer))
            kinds = {**elements.line_defines, **elements.share_defines}
        else:
            kernels, lists = ("pore_layer", "draw_pore_layer"), elements.pore_lists
            given, kinds = (elements.centres, elements.roots, stretches[-1]), {}
        launch_blocks(
            self._device, *kernels, settings, square,
            *given, lists.offsets, lists.members, into=(self._places(run), codes),
            defines={
                **self._code_defines, **kinds, "STRETCHES": len(run.samples),
                "TILTED": int(run.tilted), "BULGING": int(self._bulging(run.layer)),
                "PARTS": len(parts(bins)),
            },
            maps=run.share,
        )  # fmt: skip
        stretches[-1].release()

    def _tilt(self, layer: int) -> NDArray[np.float32]:
        """The argument `tilt` of a bin."""
        count = self._settings.bins.count
        per_radian = TILT_SHARE * 2 * count / np.pi
        return np.array([*directions(count)[layer], per_radian, TILT_SHARE], np.float32)

    def _places(self, run: _Run) -> NDArray[np.int32]:
        """Where the maps of a run are among all, `maps_t` of maps.clh."""
        bins, count = self._settings.bins, len(parts(self._settings.bins))
        first = run.layer * (count * bins.samples + bins.tilt)
        tilt, behind = first + count * bins.samples, bins.layer_samples[run.layer]
        return np.array([first + run.samples.start, map_count(bins), behind, tilt], np.int32)


@lru_cache(maxsize=64)  # the same for every tile
def _drawn(settings: AssetSettings, shares: ShareRange, run: _Run) -> tuple[DrawnStretch, ...]:
    """The stretches at which a run draws."""
    response, layer = settings.response, run.layer
    per_step = 1.0 / np.maximum(quantisation_steps(settings, shares)[layer], 1e-30)
    exponent, most = drawn_depth_exponents(settings)[layer], depth_limits(settings)[layer]
    widening = response.beta_w if layer == settings.bins.count else response.alpha_w
    drawn = [
        DrawnStretch(
            r, scale(response, r, widening), scale(response, r, -exponent, most),
            float(per_step[sample]),
        )
        for sample, r in enumerate(sample_stretches(settings, layer).tolist())
        if sample in run.samples
    ]  # fmt: skip
    if run.tilted:
        width = tilt_width(settings)
        drawn += [DrawnStretch(0.0, width, 1.0, lean=lean) for lean in (1.0, -1.0)]
    return tuple(drawn)


def _each(launches: Sequence[_Launch]) -> None:
    for launch in launches:
        launch()
