"""Moments of slopes on the surface: mean slope and mean products of slopes over each texel.
Kernels: slopes.cl, cells.cl, level.cl.

After Olano and Baker 2010, "LEAN mapping", and Dupuy et al. 2013, "LEADR mapping": what a coarse
level shows of light is the distribution of the slopes of level 0, so they and their products are
averaged, not heights. Slopes are mesh length over mesh length on the surface of the frame, in the
tangent frame of its normal maps (`pipeline/tangents.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.formats.tiles import SLOPE_CHANNELS
from rhytid.pipeline.levels import Levels, Part, coarser
from rhytid.pipeline.vectors import VECTOR

# Mean slope along T and B, and the means of their products.
MOMENTS = SLOPE_CHANNELS
# Bits of a texel's code, as cells.clh has them.
RIGHT, LEFT, ABOVE, BELOW, INSIDE = 1, 2, 4, 8, 16
# Texels of a cell along a row, and rows, as cells.clh has them.
_CELL = 16, 4
# Texels that one launch takes.
_AT_ONCE = 1 << 24
# Texels of a band before each row, which may be read, but are not used.
_MARGIN = VECTOR

Texels = NDArray[np.float32]


@dataclass(frozen=True)
class _Strip(BufferGroup):
    """Some rows of a map: which triangles their cells have, and the codes of their texels."""

    row: int
    rows: int
    firsts: Buffer
    members: Buffer
    codes: Buffer

    @classmethod
    def of(
        cls, device: Device, row: int, triangles: NDArray[np.int32], codes: NDArray[np.uint8]
    ) -> _Strip:
        """triangles, codes: (rows, R)."""
        rows, side = codes.shape
        size = (side // _CELL[0], rows // _CELL[1])
        cells = size[0] * size[1]
        held, code = device.upload(triangles), device.upload(codes)
        counts = device.empty(cells, np.int32)
        device.launch("cells", "count_cells", size, held, code, counts)
        found = device.read(counts, (cells,), np.int32)
        ends = np.append(np.int32(0), np.cumsum(found >> 1, dtype=np.int32))
        firsts = device.upload((ends << 1) | np.append(found & 1, np.int32(0)))
        members = device.empty(3 * int(ends[-1]), np.int32)
        device.launch("cells", "list_cells", size, held, code, firsts, members)
        held.release()
        counts.release()
        return cls(row, rows, firsts, members, code)

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.firsts, self.members, self.codes)


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
        rows: int,
    ) -> SlopeChart:
        """triangles, codes: (R, R) of each texel, row 0 at the top, R at least 2 VECTOR.  rows: of
        a strip. In steps, where the thread uses the device so."""
        side = len(codes)
        strips = tuple(
            _Strip.of(device, row, triangles[row : row + rows], codes[row : row + rows])
            for row in range(0, side, rows)
        )
        inside = [
            Part(
                row, column, rows, _shares(device, codes[row : row + rows, column : column + rows])
            )
            for row in range(0, side, rows)
            for column in range(0, side, rows)
        ]
        above = coarser(device, inside, side, side.bit_length() - 1)
        for part in inside:
            part.buffer.release()
        return cls(side, corner, strips, above)

    @property
    def _buffers(self) -> tuple[_Strip | Levels, ...]:
        return (*self.strips, self.coverage)

    def strip_of(self, row: int) -> _Strip:
        """The strip that a row lies in."""
        return self.strips[row // self.strips[0].rows]


def _shares(device: Device, codes: NDArray[np.uint8]) -> Buffer:
    """1 where a triangle is under a texel, else 0."""
    return device.upload(((codes & INSIDE) > 0).astype(np.float32))


def strip_rows(side: int, tile: int) -> int:
    """Rows of a strip of a map of `side`² texels: what one launch takes, and not less than a tile
    of `tile`² texels, which `binned` draws as a whole."""
    return max(min(_AT_ONCE // side, side), tile)


@dataclass(frozen=True)
class Band(BufferGroup):
    """Heights of the rows of a strip, mesh units."""

    row: int
    rows: int
    side: int
    buffer: Buffer

    @classmethod
    def empty(cls, device: Device, row: int, rows: int, side: int) -> Band:
        """A band that `put` fills."""
        size = rows * (side + _MARGIN) + _MARGIN
        return cls(row, rows, side, device.empty(size, np.float32))

    @classmethod
    def of(cls, device: Device, row: int, heights: Texels) -> Band:
        """heights: (rows, R)."""
        rows, side = heights.shape
        wide = np.zeros(rows * (side + _MARGIN) + _MARGIN, np.float32)
        wide[:-_MARGIN].reshape(rows, -1)[:, _MARGIN:] = heights
        return cls(row, rows, side, device.upload(wide))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.buffer,)

    @property
    def stride(self) -> int:
        """Texels from a row to the next."""
        return self.side + _MARGIN

    def start_of(self, row: int) -> int:
        """Where a row of the band begins, counted from its first, or, below 0, behind its last."""
        return row % self.rows * self.stride + _MARGIN

    def put(self, device: Device, part: Part) -> None:
        """Copy a square of the map."""
        to = self.start_of(part.row - self.row) + part.column
        device.copy_square(part.buffer, self.buffer, (to, self.stride), part.side, 4)


@dataclass(frozen=True)
class SlopeLevels(BufferGroup):
    """Levels of a UDIM from level `least` on, 1 or 2, each (5, n, n) float32 in the order of
    MOMENTS. Values are sums over texels with a triangle, divided by all texels: `moments` divides
    by the coverage.

    side: texels per side of level 0.
    """

    side: int
    least: int
    buffers: tuple[Buffer, ...]

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return self.buffers

    def read(self, device: Device, level: int, row: int, column: int, n: int) -> Texels:
        """(5, n, n) of a square of a level."""
        side, buffer = self.side >> level, self.buffers[level - self.least]
        starts = [plane * side + row for plane in range(len(MOMENTS))]
        return np.stack([device.read_square(buffer, side, at, column, n) for at in starts])


class SlopeWork:
    """The levels of a UDIM of a frame while they are made, strip by strip from the top. Each method
    is one task of the device or less."""

    def __init__(self, device: Device, side: int, rows: int, least: int) -> None:
        """side: texels per side of level 0.  rows: of a strip.  least: the finest level that is
        asked for, 1 or 2."""
        self._device, self.side, self.rows, self.least = device, side, rows, least
        self.done = 0
        self._bands: list[Band] = []
        self._levels = [self._empty(level) for level in range(least, 3)]

    def _empty(self, level: int) -> Buffer:
        return self._device.empty(len(MOMENTS) * (self.side >> level) ** 2, np.float32)

    def band_of(self, row: int) -> Band:
        """The band that a row lies in, begun where there is none. It stays where the task fails."""
        row -= row % self.rows
        if not self._bands or self._bands[-1].row != row:
            make = partial(Band.empty, self._device, row, self.rows, self.side)
            self._bands.append(self._device.lasting(make))
        return self._bands[-1]

    def take(self, band: Band) -> None:
        """Have a band that is whole."""
        self._bands.append(band)

    def add(self, chart: SlopeChart, terms: Buffer) -> None:
        """Make what of levels 1 and 2 the bands so far are enough for; other bands are let go."""
        while self._bands and self.done < len(chart.strips):
            strip = chart.strips[self.done]
            here = next(n for n, band in enumerate(self._bands) if band.row == strip.row)
            last = strip.row + strip.rows == self.side
            if not last and here + 1 == len(self._bands):
                return
            self._add(chart, strip, terms, here)
            for band in self._bands[: here if not last else here + 1]:
                band.release()
            self._bands = self._bands[here:] if not last else []
            self.done += 1

    def _add(self, chart: SlopeChart, strip: _Strip, terms: Buffer, here: int) -> None:
        band = self._bands[here]
        before = self._bands[here - 1] if here else band
        after = self._bands[here + 1] if here + 1 < len(self._bands) else band
        heights = (
            band.buffer, *_ints(band.stride, _MARGIN, band.rows),
            before.buffer, *_ints(before.start_of(-1 if here else 0)),
            after.buffer, *_ints(after.start_of(0)),
        )  # fmt: skip
        at = _strip_arguments(chart, strip, strip.row, 0, terms)
        to = _ints(strip.row // 4, self.least == 1)
        size = (self.side // _CELL[0], strip.rows // _CELL[1])
        kept = self._levels[0], self._levels[-1]
        self._device.launch("slopes", "levels", size, *heights, *at, *to, *kept)

    def finish(self) -> SlopeLevels:
        """All levels; to be called once, after the last strip."""
        while (side := self.side >> (self.least + len(self._levels))) > 0:
            coarse, size = self._empty(self.least + len(self._levels)), (side, len(MOMENTS) * side)
            self._device.launch("level", "halve", size, self._levels[-1], *_ints(side, 0), coarse)
            self._levels.append(coarse)
        found, self._levels = SlopeLevels(self.side, self.least, tuple(self._levels)), []
        return found

    def release(self) -> None:
        """Give back what `finish` has not handed over."""
        for band in self._bands:
            band.release()
        for level in self._levels:
            level.release()
        self._bands, self._levels = [], []


def finest_moments(
    device: Device, chart: SlopeChart, terms: Buffer, around: Texels, row: int, column: int
) -> Texels:
    """(5, n, n) moments of a square of level 0 from (row, column) on: its slopes and their
    products.  around: (n + 2, n + 2) heights of it and the texels around it; what is outside of the
    map may be anything. The square must lie in one strip, or be a tile."""
    stride = around.shape[1]
    side = stride - 2
    held, out = device.upload(around), device.empty(len(MOMENTS) * side * side, np.float32)
    heights = (
        held, *_ints(stride, stride + 1, side), held, *_ints(1),
        held, *_ints((side + 1) * stride + 1),
    )  # fmt: skip
    at = _strip_arguments(chart, chart.strip_of(row), row, column, terms)
    device.launch("slopes", "finest", (side // _CELL[0], side // _CELL[1]), *heights, *at, out)
    found: Texels = device.read(out, (len(MOMENTS), side, side), np.float32)
    held.release()
    out.release()
    return found


def _strip_arguments(
    chart: SlopeChart, strip: _Strip, row: int, column: int, terms: Buffer
) -> tuple[object, ...]:
    """SURFACE of slopes.cl behind the heights, from the texel (row, column) of the map on."""
    side, (u, v) = chart.side, chart.corner
    wide, high = _CELL
    cells = _ints(side // wide, column // wide, (row - strip.row) // high)
    centre = (u * side + column + 0.5, (v + 1) * side - row - 0.5)
    at = (np.float32(part) for part in centre)
    return (strip.codes, strip.firsts, strip.members, *cells, terms, *at)


def _ints(*values: int) -> tuple[np.int32, ...]:
    return tuple(np.int32(value) for value in values)


def moments(sums: Texels, coverage: Texels) -> Texels:
    """(n, n, 5) moments of texels from `SlopeLevels` (5, n, n); 0 where no triangle is.

    coverage: (n, n), the share of each texel that has a triangle.
    """
    share = np.where(coverage > 0.0, coverage, np.float32(1.0))
    found = np.empty((*share.shape, len(sums)), np.float32)
    return np.divide(np.moveaxis(sums, 0, -1), share[..., None], out=found)
