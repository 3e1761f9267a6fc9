"""Levels: level L+1 is the mean of 2 x 2 texels of level L, down to one texel. Kernel: level.cl.
What is read of them as half floats: halves.cl."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.pipeline.work import Square

# Draws level 0: (row, column, side) in texels, all multiples of a block, to side² float32.
Draw = Callable[[int, int, int], Buffer]

# Level-0 texels per side that are drawn at once, at most: 64 MiB of float32.
_CHUNK = 4096
# Bits of half floats: of one that is infinite, and the sign.
_INFINITE, _NEGATIVE = 0x7C00, 0x8000


@dataclass(frozen=True)
class Part:
    """A square of `side`² float32 that begins at (row, column) of a larger one."""

    row: int
    column: int
    side: int
    buffer: Buffer


@dataclass(frozen=True)
class Levels(BufferGroup):
    """Some levels of a square, finest first.

    side: texels per side of the finest; each that follows has half as many.  buffers: float32.
    """

    side: int
    buffers: tuple[Buffer, ...]

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return self.buffers


def coarser(device: Device, parts: Sequence[Part], side: int, count: int) -> Levels:
    """The `count` levels above a square of `side`² texels, which `parts` make up.

    Every texel is the same tree of sums whatever the parts, so any cut gives the same bits.
    """
    buffers: list[Buffer] = []
    for n in range(1, count + 1):
        coarse = device.empty((side >> n) ** 2, np.float32)
        for part in parts:
            _halve(device, part, coarse, side >> n)
        parts = [Part(0, 0, side >> n, coarse)]
        buffers.append(coarse)
    return Levels(side // 2, tuple(buffers))


def render_to_host(
    device: Device, draw: Draw, level: int, row: int, column: int, side: int
) -> NDArray[np.float32]:
    """(side, side) float32 of a level, from texel (row, column) of that level on, of the map that
    `draw` draws. At most a chunk of it is on the device at a time."""
    span = side << level
    if span > _CHUNK and side > 1:
        half = side // 2
        quarters = [
            [render_to_host(device, draw, level, row + y, column + x, half) for x in (0, half)]
            for y in (0, half)
        ]
        return np.block(quarters)
    if span > _CHUNK:
        buffer = device.upload(render_to_host(device, draw, level - 1, 2 * row, 2 * column, 2))
        span, level = 2, 1
    else:
        buffer = draw(row << level, column << level, span)
    if level:
        levels = coarser(device, [Part(0, 0, span, buffer)], span, level)
        result = device.read(levels.buffers[-1], (side, side), np.float32)
        levels.release()
    else:
        result = device.read(buffer, (side, side), np.float32)
    buffer.release()
    return result


def read_halves(device: Device, buffer: Buffer, side: int) -> NDArray[np.float16] | None:
    """(side, side) float32 of the device as half floats, rounded to even, in half of the bytes;
    side is a multiple of 4. None where half floats cannot hold one of them."""
    codes = device.empty(side * side, np.uint16)
    device.launch("halves", "half_floats", (side * side // 16,), buffer, codes)
    found = device.read(codes, (side, side), np.uint16)
    codes.release()
    # Infinite ones have the largest codes of their sign.
    if found.max() >= _INFINITE | _NEGATIVE or found.view(np.int16).max() >= _INFINITE:
        return None
    return found.view(np.float16)


def read_parts(
    device: Device, parts: Sequence[Part], place: Square, out: NDArray[np.float32 | np.float16]
) -> None:
    """Read a square of level 0 that several parts make up, or that lies in one.

    out: (side, side) takes it; where it is of half floats each number is rounded to even, and
    infinite where they cannot hold it.
    """
    if out.dtype == np.float16:
        codes = _joined_halves(device, parts, place)
        device.read_squares([(codes, place[2], 0, 0)], [out.view(np.uint16)])
        codes.release()
        return
    cuts = [_cut(part, place) for part in parts]
    device.read_squares(
        [(part.buffer, part.side, *cut.first) for part, cut in zip(parts, cuts, strict=True)],
        [out[y : y + n, x : x + n] for _, (y, x), n in cuts],
    )


def _joined_halves(device: Device, parts: Sequence[Part], place: Square) -> Buffer:
    """The bits of half floats of a square."""
    codes = device.empty(place[2] ** 2, np.uint16)
    for part in parts:
        (top, left), (y, x), n = _cut(part, place)
        first, to = top * part.side + left, y * place[2] + x
        numbers = map(np.int32, (first, part.side, to, place[2]))
        device.launch("halves", "half_square", (n // 16, n), part.buffer, *numbers, codes)
    return codes


class _Cut(NamedTuple):
    """What a part and a square have in common: (row, column) in the part, in the square, and its
    texels per side."""

    first: tuple[int, int]
    to: tuple[int, int]
    side: int


def _cut(part: Part, place: Square) -> _Cut:
    row, column, side = place
    top, left = max(part.row, row), max(part.column, column)
    inside, to = (top - part.row, left - part.column), (top - row, left - column)
    return _Cut(inside, to, min(part.side, side))


def _halve(device: Device, part: Part, coarse: Buffer, side: int) -> None:
    first = part.row // 2 * side + part.column // 2
    half = part.side // 2
    device.launch(
        "level", "halve", (half, half), part.buffer, np.int32(side), np.int32(first), coarse
    )
