"""Precomputed maps of the fast method (section 2.4). Kernels: bins.cl, quantise.cl."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import count as counter
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rhytid.device.held import Held
from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings, BinSettings
from rhytid.domain.stiffness import Stiffness
from rhytid.pipeline.elements import SCALE_LIMIT, UdimElements
from rhytid.pipeline.levels import Draw, render
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import launch_blocks
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.vectors import VECTOR, VectorTriangles

# What bulges and overlaps may add to the deepest furrow, in units of depth.
HEADROOM = 0.2
# The C type of a code, by its bits.
CODES = {8: "char", 16: "short"}
# Tilts are drawn from wrinkles whose depths are scaled by 1 ± this from edge to edge of a bin.
TILT_SHARE = 0.25
# The layer of tilts; its maps follow those of all others.
TILTS = "wrinkle_tilts"


def directions(count: int, turn: float = 0.0) -> NDArray[np.float64]:
    """(N, 2) θₙ = (sin αₙ, cos αₙ) with αₙ = πn/N (Alg. 3, line 7).  turn: all of them, in bins."""
    angles = np.pi * (np.arange(count) + turn) / count
    return np.stack([np.sin(angles), np.cos(angles)], axis=1)


def sample_stretches(settings: AssetSettings, layer: int = 0) -> NDArray[np.float64]:
    """(M,) log stretch of each sample of a layer, evenly spaced around 0, which is the middle."""
    samples = settings.bins.layer_samples[layer]
    steps = np.arange(samples, dtype=np.float64) - (samples - 1) / 2
    return steps * (2.0 * settings.last_sample / (samples - 1))


def scale(r: float, exponent: float) -> float:
    """exp(r)^exponent within the limits of the response (Alg. 1, lines 7 and 8)."""
    return float(np.clip(math.exp(exponent * r), 1.0 / SCALE_LIMIT, SCALE_LIMIT))


def drawn_depth_exponents(settings: AssetSettings) -> list[float]:
    """How the depth of each layer's maps goes with their stretch, bins first, then the pores:
    as Alg. 1 and 2 have it, or not at all where the depth scale is multiplied on later."""
    response, bins = settings.response, settings.bins
    if bins.depth_factored:
        return [0.0] * (bins.count + 1)
    return [response.alpha_d] * bins.count + [response.beta_d]


def parts(bins: BinSettings) -> tuple[int, ...]:
    """The maps of one bin and sample: one signed map, or valleys and bulges apart (draw.clh)."""
    return (1, 2) if bins.merge == "mellow" else (0,)


def layers(bins: BinSettings) -> dict[str, tuple[int, ...]]:
    """The layers of maps by name, each with the index of the first map of every bin of it.

    `wrinkles` and `pores`; of `mellow` these are the valleys, and `wrinkle_bulges` and
    `pore_bulges` are the bulges. Each has the maps of all samples. With tilts `wrinkle_tilts`, one
    map a bin.
    """
    count, samples = len(parts(bins)), bins.samples
    first = range(0, map_count(bins), count * samples + bins.tilt)[: bins.count + 1]  # of layers
    names = (("wrinkles", "pores"), ("wrinkle_bulges", "pore_bulges"))
    found: dict[str, tuple[int, ...]] = {}
    for part, (wrinkles, pores) in enumerate(names[:count]):
        found[wrinkles] = tuple(index + part * samples for index in first[:-1])
        found[pores] = (first[-1] + part * bins.layer_samples[-1],)
    if bins.tilt:
        found[TILTS] = tuple(index + count * samples for index in first[:-1])
    return found


def map_count(bins: BinSettings) -> int:
    """Precomputed maps of a tile: of every layer, part and sample, and the tilt of every bin."""
    tilts = bins.count if bins.tilt else 0
    return sum(bins.layer_samples) * len(parts(bins)) + tilts


def code_limit(bits: int) -> int:
    """The largest code of a symmetric quantisation."""
    return int(2 ** (bits - 1) - 1)


def quantisation_steps(settings: AssetSettings) -> NDArray[np.float32]:
    """(N + 1, M) displacement of one code, mesh units; the last row is the pore layer. M is that
    of the layer with most samples; rows of fewer end in zeros.

    Known before anything is drawn, so that tiles can be made one at a time.
    """
    assert settings.depth is not None
    bins = settings.bins
    found = np.zeros((bins.count + 1, max(bins.layer_samples)), np.float32)
    for layer, exponent in enumerate(drawn_depth_exponents(settings)):
        depths = np.array([scale(r, -exponent) for r in sample_stretches(settings, layer)])
        step = settings.depth * (depths + HEADROOM) / code_limit(bins.bits)
        found[layer, : len(depths)] = step
    return found


@dataclass(frozen=True)
class BinTile(Held):
    """One tile of every precomputed map, padded to a vector, and the triangles of its texels.

    codes: (texels / VECTOR, maps, VECTOR), maps being M samples within parts within N + 1
    layers, and after those of a bin its tilt.
    stiffness: float32 of each texel, or None: 1 throughout.
    place: texels a side of the tile and of its level, row and column of its first texel."""

    triangles: VectorTriangles
    codes: Buffer
    texels: int
    place: tuple[np.int32, np.int32, np.int32, np.int32]
    stiffness: Buffer | None = None

    @property
    def _buffers(self) -> tuple[VectorTriangles | Buffer | None, ...]:
        return (self.triangles, self.codes, self.stiffness)


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
        self._steps = quantisation_steps(settings)

    def tile(self, level: int, row: int, column: int, texels: int) -> BinTile:
        """All layers and samples of `texels`² texels, from texel (row, column) of the level on."""
        bins = self._settings.bins
        size = max(texels * texels, VECTOR)
        codes = self._device.empty(map_count(bins) * size, f"i{bins.bits // 8}")
        at = counter()
        for layer, samples in enumerate(bins.layer_samples):
            for part, sample in product(parts(bins), range(samples)):
                draw = self._draw(layer, part, sample)
                heights = render(self._device, draw, level, row, column, texels)
                step = self._steps[layer, sample]
                self._quantise(heights, texels * texels, step, next(at), codes)
                heights.release()
            if bins.tilt and layer < bins.count:
                self._tilt(layer, (level, row, column, texels), next(at), codes)
        side = self._settings.resolution >> level
        place = (np.int32(texels), np.int32(side), np.int32(row), np.int32(column))
        triangles = self._located.texels(side, row, column, texels)
        vectors = VectorTriangles.of(self._device, triangles, size)
        triangles.release()
        stiffness = stiffness_of_texels(
            self._device, self._stiffness, self._located.udim, side, row, column, texels
        )
        return BinTile(vectors, codes, size, place, stiffness)

    def _quantise(
        self, heights: Buffer, count: int, step: np.float32, index: int, codes: Buffer
    ) -> None:
        self._device.launch(
            "quantise", "quantise", (count,),
            heights, step, np.int32(index), codes,
            defines=self._code_defines(),
        )  # fmt: skip
        self._device.finish()

    def _tilt(self, index: int, place: tuple[int, int, int, int], at: int, codes: Buffer) -> None:
        """Codes of where in the bin the wrinkles run, drawn as wide as they ever are."""
        r = self._settings.last_sample
        scales = _float2(scale(r, self._settings.response.alpha_w), 1.0)
        draws = (self._draw_bin(index, scales, 0, s) for s in (TILT_SHARE, -TILT_SHARE))
        up, down = (render(self._device, draw, *place) for draw in draws)
        self._device.launch(
            "tilt", "tilt_codes", (place[-1] ** 2,),
            up, down, np.float32(TILT_SHARE), np.int32(at), codes,
            defines=self._code_defines(),
        )  # fmt: skip
        self._device.finish()
        up.release()
        down.release()

    def _code_defines(self) -> dict[str, object]:
        bins = self._settings.bins
        limit = code_limit(bins.bits)
        return {"CODE": CODES[bins.bits], "CODE_LIMIT": limit, "MAPS": map_count(bins)}

    def _draw(self, layer: int, part: int, sample: int) -> Draw:
        settings, response = self._settings, self._settings.response
        r = float(sample_stretches(settings, layer)[sample])
        depth = scale(r, -drawn_depth_exponents(settings)[layer])
        if layer == settings.bins.count:
            return self._draw_pores(_float2(scale(r, response.beta_w), depth), part)
        return self._draw_bin(layer, _float2(scale(r, response.alpha_w), depth), part)

    def _draw_bin(
        self, index: int, scales: NDArray[np.float32], part: int, tilt: float = 0.0
    ) -> Draw:
        elements, lists = self._elements, self._elements.wrinkle_lists
        count = self._settings.bins.count
        leaning = np.array([*directions(count)[index], tilt * 2 * count / np.pi, 0.0], np.float32)

        def draw(row: int, column: int, side: int) -> Buffer:
            return launch_blocks(
                self._device, "bins", "draw_wrinkle_bin", self._settings, elements,
                row, column, side,
                elements.segments, elements.sizes, elements.bins, np.int32(index), scales,
                np.int32(part), leaning, lists.offsets, lists.members,
                *elements.wave_arguments,
            )  # fmt: skip

        return draw

    def _draw_pores(self, scales: NDArray[np.float32], part: int) -> Draw:
        elements, lists = self._elements, self._elements.pore_lists

        def draw(row: int, column: int, side: int) -> Buffer:
            return launch_blocks(
                self._device, "bins", "draw_pore_layer", self._settings, elements,
                row, column, side,
                elements.centres, elements.roots, scales, np.int32(part),
                lists.offsets, lists.members,
            )  # fmt: skip

        return draw


def _float2(x: float, y: float) -> NDArray[np.float32]:
    return np.array([x, y], np.float32)
