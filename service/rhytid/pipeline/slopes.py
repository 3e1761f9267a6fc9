"""Moments of slopes on the surface: mean slope and mean products of slopes over each texel.
Kernels: slopes.cl, level.cl.

After Olano and Baker 2010, "LEAN mapping", and Dupuy et al. 2013, "LEADR mapping": what a coarse
level shows of light is the distribution of the slopes of level 0, so they and their products are
averaged, not heights. Slopes are mesh length over mesh length on the surface of the frame, in the
tangent frame of its normal maps (`exports/textures/slope_terms.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.formats.tiles import SLOPE_CHANNELS
from rhytid.pipeline.levels import Levels, Part, coarser
from rhytid.pipeline.vectors import VECTOR, VectorTriangles

# Mean slope along T and B, and the means of their products.
MOMENTS = SLOPE_CHANNELS
# Floats of a triangle, TERMS of slopes.cl.
TERMS = 32
# Bits of a texel's code, as slopes.cl has them.
RIGHT, LEFT, ABOVE, BELOW, INSIDE = 1, 2, 4, 8, 16
# Texels that one launch takes.
_AT_ONCE = 1 << 24

Texels = NDArray[np.float32]


@dataclass(frozen=True)
class _Strip(BufferGroup):
    """Some rows of a map: which triangles their vectors have, and the codes of their texels."""

    row: int
    rows: int
    triangles: VectorTriangles
    codes: Buffer

    @property
    def _buffers(self) -> tuple[VectorTriangles | Buffer, ...]:
        return (self.triangles, self.codes)


@dataclass(frozen=True)
class SlopeChart(BufferGroup):
    """What of a UDIM does not change with the frame.

    side: texels per side.  corner: of the UDIM, (u, v).  strips: from the top.  coverage: levels 1
    and coarser of which share of a texel has a triangle under it.
    """

    side: int
    corner: tuple[int, int]
    strips: tuple[_Strip, ...]
    coverage: Levels

    @classmethod
    def of(
        cls,
        device: Device,
        triangles: NDArray[np.int32],
        codes: NDArray[np.uint8],
        corner: tuple[int, int],
    ) -> SlopeChart:
        """triangles, codes: (R, R) of each texel, row 0 at the top, R at least 2 VECTOR."""
        side = len(codes)
        rows = max(min(_AT_ONCE // side, side), 2)
        strips = []
        for row in range(0, side, rows):
            held = device.upload(triangles[row : row + rows])
            found = VectorTriangles.of(device, held, rows * side)
            held.release()
            strips.append(_Strip(row, rows, found, device.upload(codes[row : row + rows])))
        inside = device.upload(((codes & INSIDE) > 0).astype(np.float32))
        above = coarser(device, [Part(0, 0, side, inside)], side, side.bit_length() - 1)
        inside.release()
        return cls(side, corner, tuple(strips), above)

    @property
    def _buffers(self) -> tuple[_Strip | Levels, ...]:
        return (*self.strips, self.coverage)

    def strip_of(self, row: int) -> _Strip:
        """The strip that a row lies in."""
        return self.strips[row // self.strips[0].rows]


@dataclass(frozen=True)
class SlopeLevels(BufferGroup):
    """Levels 1 and coarser of a UDIM, one `Levels` per moment, in the order of MOMENTS. Values are
    sums over texels with a triangle, divided by all texels: `moments` divides by the coverage."""

    planes: tuple[Levels, ...]

    @property
    def _buffers(self) -> tuple[Levels, ...]:
        return self.planes


class SlopeStage:
    """Makes moments of the slopes of heights."""

    def __init__(self, device: Device) -> None:
        self._device = device

    def levels(self, chart: SlopeChart, terms: Buffer, heights: Texels | Buffer) -> SlopeLevels:
        """All levels above level 0.

        terms: of the triangles of the frame, TERMS float32 each.  heights: (R, R) of level 0, mesh
        units; or on the device, with one more row before and behind, whatever is in it.
        """
        side, device = chart.side, self._device
        first = [device.empty(side * side // 4, np.float32) for _ in MOMENTS]
        for strip, rows, start in self._strips(chart, heights):
            at = self._surface(chart, strip, (strip.row, 0), rows, side, start, terms)
            to = np.int32(strip.row // 2 * (side // VECTOR))
            size = (side // VECTOR, strip.rows // 2)
            device.launch("slopes", "halved", size, *at, to, *first)
            if not isinstance(heights, Buffer):
                rows.release()
        return SlopeLevels(tuple(self._above(plane, side // 2) for plane in first))

    def _above(self, plane: Buffer, side: int) -> Levels:
        """Level 1 and what is coarser."""
        above = coarser(self._device, [Part(0, 0, side, plane)], side, side.bit_length() - 1)
        return Levels(side, (plane, *above.buffers))

    def _strips(
        self, chart: SlopeChart, heights: Texels | Buffer
    ) -> Iterator[tuple[_Strip, Buffer, int]]:
        """Each strip, heights on the device, and where the first of the strip is in them."""
        side = chart.side
        for strip in chart.strips:
            if isinstance(heights, Buffer):
                yield strip, heights, (strip.row + 1) * side
            else:
                rows = np.arange(strip.row - 1, strip.row + strip.rows + 1).clip(0, side - 1)
                yield strip, self._device.upload(heights[rows]), side

    def finest(
        self, chart: SlopeChart, terms: Buffer, around: Texels, row: int, column: int
    ) -> Texels:
        """(5, n, n) moments of a square of level 0 from (row, column) on: its slopes and their
        products.  around: (n + 2, n + 2) heights of it and the texels around it; what is outside of
        the map may be anything finite. The square must lie in one strip, or be a tile."""
        device, stride = self._device, around.shape[1]
        side = stride - 2
        held, planes = (
            device.upload(around),
            [device.empty(side * side, np.float32) for _ in MOMENTS],
        )
        strip = chart.strip_of(row)
        at = self._surface(chart, strip, (row, column), held, stride, stride + 1, terms)
        device.launch("slopes", "finest", (side // VECTOR, side), *at, *planes)
        found = np.stack([device.read(plane, (side, side), np.float32) for plane in planes])
        for buffer in (held, *planes):
            buffer.release()
        return found

    def _surface(
        self,
        chart: SlopeChart,
        strip: _Strip,
        place: tuple[int, int],
        heights: Buffer,
        stride: int,
        start: int,
        terms: Buffer,
    ) -> Sequence[object]:
        """SURFACE of slopes.cl, from the texel `place` of the map on."""
        side, (u, v), (row, column) = chart.side, chart.corner, place
        vectors = side // VECTOR
        corner = (row - strip.row) * vectors + column // VECTOR
        centre = (u * side + column + 0.5, (v + 1) * side - row - 0.5)
        firsts, members = strip.triangles.firsts, strip.triangles.members
        return (
            heights, np.int32(stride), np.int32(start), strip.codes, firsts, members,
            np.int32(vectors), np.int32(corner), terms, *(np.float32(at) for at in centre),
        )  # fmt: skip


def moments(sums: Texels, coverage: Texels) -> Texels:
    """(n, n, 5) moments of texels from `SlopeLevels` (5, n, n); 0 where no triangle is.

    coverage: (n, n), the share of each texel that has a triangle.
    """
    share = np.where(coverage > 0.0, coverage, np.float32(1.0))
    found = np.empty((*share.shape, len(sums)), np.float32)
    return np.divide(np.moveaxis(sums, 0, -1), share[..., None], out=found)
