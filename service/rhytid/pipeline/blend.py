"""Blends precomputed maps by the stretch of a frame (Alg. 3), those of the broad layer by that of
the owners of its samples. Kernels: weights.cl, blend.cl, blend_smooth.cl, blend_stiff.cl,
blend_cushions.cl."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, BinSettings
from rhytid.pipeline.bin_maker import BinTile
from rhytid.pipeline.bins import (
    CODES,
    EVEN,
    TILT_NODE,
    ShareRange,
    code_limit,
    directions,
    map_count,
    parts,
    quantisation_steps,
)
from rhytid.pipeline.cushion import SAMPLES, CushionTile, cushion_steps, last_stretch
from rhytid.pipeline.cushion_layer import APRON
from rhytid.pipeline.grain import grain_amplitude, grain_exponent, relief
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.nearby import Groups
from rhytid.pipeline.reach import SCALE_LIMIT, bulging, response_defines
from rhytid.pipeline.smooth import SmoothFields
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import Place

# How merge.clh calls a merge. `signed` is `mellow` of one signed map in place of two.
MERGES = {"min": "MIN", "soft": "SOFT", "signed": "MELLOW", "mellow": "MELLOW"}
# That blend.cl and blend_cushions.cl take. Of fewer one core would wait for the other at the end of
# each launch.
TILES_A_LAUNCH = 16


def unit_of(settings: AssetSettings) -> float:
    """The unit in which merge.clh merges heights, mesh units."""
    assert settings.depth is not None
    twice = math.log(2.0) * settings.depth / settings.shape.sharpness
    return {"MIN": 1.0, "SOFT": 4.0 * twice, "MELLOW": twice}[MERGES[settings.bins.merge]]


def _directions(bins: BinSettings) -> NDArray[np.float32]:
    """θ of each bin; then, for tilts, TILT_NODE half bins to either side of each."""
    turns = (0.0, -TILT_NODE / 2, TILT_NODE / 2) if bins.tilt else (0.0,)
    return np.concatenate([directions(bins.count, turn) for turn in turns]).astype(np.float32)


@dataclass(frozen=True)
class Coefficients(BufferGroup):
    """The factors that a frame multiplies codes by.

    own: factors of the codes of each layer in each triangle.  gains: factors of the grain, None
    where there is no grain.  filled: UDIMs and squares whose triangles have both; None: all.
    """

    own: Buffer
    gains: Buffer | None = None
    filled: set[Place | None] = field(default_factory=set, init=False)

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.own, self.gains)


class _Raised(NamedTuple):
    """The broad layer of tiles, one after the other, with so many values each, and what kernels
    must know of it."""

    coarse: Buffer | None
    values: int
    defines: Mapping[str, object]


class Blend:
    """Blends tiles of precomputed maps of one asset."""

    def __init__(
        self,
        device: Device,
        settings: AssetSettings,
        triangles: int,
        shares: ShareRange = EVEN,
    ) -> None:
        """triangles: how many the mesh has.  shares: of its graph."""
        assert settings.depth is not None
        self._cushion: CushionBlend | None = None
        if settings.shape.cushion > 0.0:
            self._cushion = CushionBlend(device, settings, shares)
        self._settings = settings
        bins, response = settings.bins, settings.response
        self._device, self._bins, self._triangles = device, bins, triangles
        self._last_sample = np.float32(settings.last_sample)
        self._unit = np.float32(unit_of(settings))
        self._grain_exponent = np.float32(grain_exponent(settings))
        exponents = [response.alpha_d, response.beta_d] if bins.depth_factored else [0.0, 0.0]
        limits = [SCALE_LIMIT, response.pore_depth_limit]
        self._exponents = np.array([*exponents, *limits], np.float32)
        self._response = response_defines(response.soft_limits)
        self._directions = device.upload(_directions(bins))
        self._steps = device.upload(quantisation_steps(settings, shares))
        self._layers: dict[str, object] = {
            "LAYERS": bins.count + 1,
            "SAMPLES": bins.samples,
            "PORE_SAMPLES": bins.layer_samples[-1],
            "TILT": int(bins.tilt),
            "TILT_NODE": f"{TILT_NODE}f",
            "CODE_LIMIT": code_limit(bins.bits),
        }
        self._oriented = {"ORIENTED": bins.count if bins.count > 1 else 0}
        self._codes = {
            "CODE": CODES[bins.bits],
            "CODE_BITS": bins.bits,
            "PARTS": len(parts(bins)),
            "MERGE": MERGES[bins.merge],
            "MAPS": map_count(bins),
            "BULGING": int(bulging(settings.shape)),
            **device.ahead_defines,
        }

    def coefficients(self, stretch: StretchBuffers) -> Coefficients:
        """The factors of the codes of each layer in each triangle: where it stands between
        the samples and the depth scale that its maps lack (Alg. 3, lines 6 to 10)."""
        found = self.unfilled()
        self.fill(found, stretch, None)
        return found

    def unfilled(self) -> Coefficients:
        """The factors of a frame, to be filled."""
        count, grainy = self._triangles + 1, relief(self._settings) > 0.0
        own = self._device.empty(4 * count * (self._bins.count + 1), np.float32)
        return Coefficients(own, self._device.empty(count, np.float32) if grainy else None)

    def fill(self, found: Coefficients, stretch: StretchBuffers, wanted: Groups | None) -> None:
        """Fill the factors in some triangles; None: in all."""
        count, groups = np.int32(self._triangles + 1), wanted or Groups.of(self._triangles + 1)
        self._device.launch(
            "weights", "coefficients", (groups.items,), groups.numbers,
            *self._stretch(stretch), count, self._last_sample, self._exponents,
            self._steps, self._unit, self._grain_exponent, found.gains, found.own,
            defines={**self._layers, **self._response, **self._oriented},
        )  # fmt: skip

    def stretches(self, stretch: StretchBuffers) -> Buffer:
        """Log stretch of each triangle and layer, which `stiff_tile` takes in place of coefficients
        (Alg. 3, lines 6 and 7)."""
        count = self._triangles + 1
        sides = 3 if self._bins.tilt else 1
        found = self._device.empty(sides * count * (self._bins.count + 1), np.float32)
        self._device.launch(
            "weights", "layer_stretches", (count,), *self._stretch(stretch), found,
            defines={**self._layers, **self._response, **self._oriented},
        )  # fmt: skip
        return found

    def tile(
        self,
        maps: BinTile,
        coefficients: Coefficients,
        grain: Buffer | None = None,
        lines: Buffer | None = None,
    ) -> Buffer:
        """float32 displacement of one tile, on the device (Alg. 3, lines 11 to 15).

        grain: codes of its texels, to be added where they are given.  lines: as in `tiles`."""
        return self.tiles([maps], coefficients, None if grain is None else [grain], lines)[0]

    def tiles(
        self,
        tiles: Sequence[BinTile],
        coefficients: Coefficients,
        grains: Sequence[Buffer] | None = None,
        lines: Buffer | None = None,
    ) -> list[Buffer]:
        """float32 displacement of tiles with equally many texels.

        lines: `ends` of LineStretches, where the tiles have a broad layer.
        """
        made = [self._device.empty(maps.texels, np.float32) for maps in tiles]
        for first in range(0, len(tiles), TILES_A_LAUNCH):
            some = slice(first, first + TILES_A_LAUNCH)
            codes = grains[some] if grains else [None] * len(made[some])
            with self._raised(tiles[some], lines) as raised:
                parts = list(zip(tiles[some], codes, made[some], strict=True))
                self._launch_blend(parts, coefficients, raised)
        return made

    def _launch_blend(
        self,
        parts: Sequence[tuple[BinTile, Buffer | None, Buffer]],
        coefficients: Coefficients,
        raised: _Raised,
    ) -> None:
        """Blend TILES_A_LAUNCH tiles at most.

        parts: each tile, the codes of its grain, and where it is written.  raised: of these tiles.
        """
        first, grain, _ = parts[0]
        vectors = first.texels // VECTOR
        of_each = [
            (tile.triangles.firsts, tile.triangles.members, tile.codes, *others)
            for tile, *others in parts
        ]
        self._device.launch(
            "blend", "blend", (vectors, len(parts)),
            *_of_all(of_each), coefficients.own,
            None if grain is None else coefficients.gains, raised.coarse,
            np.int32(raised.values), self._unit, first.place[0],
            np.float32(grain_amplitude(self._settings)), np.float32(self._settings.depth),
            group=_group(self._device.shape.vectors, vectors),
            defines={
                **self._layers, **self._codes, **raised.defines,
                **({} if grain is None else {**self._response, "GRAINY": 1}),
            },
        )  # fmt: skip

    def stiff_tile(self, maps: BinTile, stretches: Buffer, lines: Buffer | None = None) -> Buffer:
        """float32 displacement of a tile whose texels have a stiffness (Alg. 3, lines 8 to 15).

        stretches: the result of the method `stretches`.  lines: as in `tiles`.
        """
        out = self._device.empty(maps.texels, np.float32)
        with self._raised([maps], lines) as raised:
            self._device.launch(
                "blend_stiff", "blend_stiff", (maps.texels // VECTOR,),
                maps.triangles.firsts, maps.triangles.members, maps.stiffness, maps.codes,
                stretches, self._steps, self._last_sample, self._exponents, self._unit,
                maps.place[0], raised.coarse, out,
                defines={**self._sampled, **raised.defines},
            )  # fmt: skip
        return out

    def smooth_tile(
        self,
        maps: BinTile,
        fields: SmoothFields,
        located: UdimTriangles,
        lines: Buffer | None = None,
    ) -> Buffer:
        """float32 displacement of a tile with a stretch of its own for every texel (Alg. 3, lines 2
        to 15).

        lines: as in `tiles`, by the same fields.
        """
        out = self._device.empty(maps.texels, np.float32)
        with self._raised([maps], lines) as raised:
            self._device.launch(
                "blend_smooth", "blend_smooth", (maps.texels // VECTOR,),
                maps.triangles.firsts, maps.triangles.members, maps.codes, self._steps,
                self._directions, self._last_sample, self._exponents, self._unit,
                *maps.place, *fields.arguments(located),
                fields.neutral, maps.stiffness, raised.coarse, out,
                defines={**self._sampled, **raised.defines},
            )  # fmt: skip
        return out

    @contextmanager
    def _raised(self, tiles: Sequence[BinTile], lines: Buffer | None) -> Iterator[_Raised]:
        """The broad layer of tiles; it is released when the block ends. Nothing where a tile has
        none."""
        found = [maps.cushion for maps in tiles if maps.cushion is not None]
        if self._cushion is None or len(found) < len(tiles):
            yield _Raised(None, 0, {})
            return
        assert lines is not None
        coarse = self._cushion.tiles(found, lines)
        texels = int(tiles[0].place[0])
        defines = {"RAISED": 1, "COARSER": texels // (found[0].side - 2 * APRON)}
        yield _Raised(coarse, found[0].values, defines)
        coarse.release()

    @property
    def _sampled(self) -> dict[str, object]:
        """The defines of the kernels that find r of each texel."""
        return {**self._layers, **self._response, **self._oriented, **self._codes}

    def _stretch(self, stretch: StretchBuffers) -> tuple[object, ...]:
        return (stretch.axes, stretch.logs, stretch.jacobians, self._directions)

    def release(self) -> None:
        """Give the memory back."""
        self._directions.release()
        self._steps.release()
        if self._cushion is not None:
            self._cushion.release()


@cache
def _group(most: int, vectors: int) -> tuple[int, int]:
    """The largest work-group that the vectors of a tile can be cut into."""
    return next(n for n in range(min(most, vectors), 0, -1) if vectors % n == 0), 1


def _of_all(of_each: Sequence[tuple[object, ...]]) -> Iterator[object]:
    """The arguments of each tile of a launch, and None for those that it could have taken."""
    none = (None,) * len(of_each[0])
    return chain(*of_each, *[none] * (TILES_A_LAUNCH - len(of_each)))


class CushionBlend:
    """Blends tiles of the broad layer of one asset."""

    def __init__(self, device: Device, settings: AssetSettings, shares: ShareRange = EVEN) -> None:
        """shares: of the graph of the asset."""
        bits, response = settings.bins.bits, settings.response
        self._device = device
        self._steps = device.upload(cushion_steps(settings, shares))
        self._last = np.float32(last_stretch(settings))
        self._exponent = np.float32(response.alpha_d)
        self._defines: dict[str, object] = {
            **response_defines(response.soft_limits),
            "SAMPLES": SAMPLES,
            "CODE": CODES[bits],
            "CODE_BITS": bits,
            "CODE_LIMIT": code_limit(bits),
            **device.ahead_defines,
        }

    def tiles(self, tiles: Sequence[CushionTile], lines: Buffer) -> Buffer:
        """float32 displacement of the samples of tiles, TILES_A_LAUNCH at most with equally many
        samples, on the device, one tile after the other with `CushionTile.values` each. One
        buffer, as each costs the host some microseconds in every launch.

        lines: `ends` of LineStretches.
        """
        vectors, values = tiles[0].side ** 2 // VECTOR, tiles[0].values
        made = self._device.empty(len(tiles) * values, np.float32)
        of_each = [(maps.owners, maps.codes) for maps in tiles]
        self._device.launch(
            "blend_cushions", "blend_cushions", (vectors, len(tiles)),
            *_of_all(of_each), lines, self._steps, self._last, self._exponent,
            np.int32(values), made,
            group=_group(self._device.shape.vectors, vectors),
            defines=self._defines,
        )  # fmt: skip
        return made

    def release(self) -> None:
        """Give the memory back."""
        self._steps.release()
