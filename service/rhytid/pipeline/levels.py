"""Levels: level L+1 is the mean of 2 x 2 texels of level L, down to one texel. Kernel: level.cl."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.pipeline.vectors import VECTOR

# Draws level 0: (row, column, side) in texels, all multiples of a block, to side² float32.
Draw = Callable[[int, int, int], Buffer]

# Level-0 texels per side that are drawn at once, at most: 64 MiB of float32.
_CHUNK = 4096


def in_one_piece(level: int, side: int) -> bool:
    """Whether `render` of so many texels of a level stays on the device."""
    return side << level <= _CHUNK


def render(device: Device, draw: Draw, level: int, row: int, column: int, side: int) -> Buffer:
    """`side`² texels of a level, from texel (row, column) of that level on, with room for a vector.

    Every texel is the same tree of sums whatever the cut, so any tiling gives the same bits.
    """
    span = side << level
    if span <= _CHUNK:
        return _halved(device, draw(row << level, column << level, span), span, level)
    if side == 1:
        finer = render(device, draw, level - 1, 2 * row, 2 * column, 2)
        return _halved(device, finer, 2, 1)
    host = render_to_host(device, draw, level, row, column, side)
    return device.upload(np.resize(host, max(host.size, VECTOR)))


def render_to_host(
    device: Device, draw: Draw, level: int, row: int, column: int, side: int
) -> NDArray[np.float32]:
    """As `render`, read back; (side, side) float32. Never more than a chunk is on the device."""
    if side << level > _CHUNK and side > 1:
        half = side // 2
        quarters = [
            [render_to_host(device, draw, level, row + y, column + x, half) for x in (0, half)]
            for y in (0, half)
        ]
        return np.block(quarters)
    buffer = render(device, draw, level, row, column, side)
    result: NDArray[np.float32] = device.read(buffer, (side, side), np.float32)
    buffer.release()
    return result


def _halved(device: Device, fine: Buffer, side: int, times: int) -> Buffer:
    for _ in range(times):
        side //= 2
        coarse = device.empty(max(side * side, VECTOR), np.float32)  # quantised by vectors
        device.launch("level", "halve", (side, side), fine, coarse)
        fine.release()
        fine = coarse
    return fine
