"""Finds valley lines and pits of a relief, each at the scale at which it answers strongest, and how
much noise the relief has. Kernel: ridges.cl.

A map is looked at tile by tile, each with what smoothing reads around it: any tiling gives the same
bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pipeline.vectors import VECTOR
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.surface import joined, taken
from rhytid.synthesis.workspace import Workspace

Floats = NDArray[np.float64]
# Standard deviations of the Gaussians, texels: of lines, and further ones of pits alone.
LINE_SCALES: tuple[float, ...] = (0.8, 1.1, 1.6, 2.2)
# Of lines that have a broad layer, whose curvature would tell of that at the other scales:
# neighbours would be one line, and a faint one on the slope of a deep one none.
NARROW_SCALES: tuple[float, ...] = (0.8, 1.1)
SCALES = (*LINE_SCALES, 3.1, 4.4)
# Of these a Gaussian is followed so far.
_TRUNCATED = 5.0
# Powers of the scale that make the answers of lines and of pits comparable (Lindeberg 1998).
LINE_POWER, PIT_POWER = 1.5, 2.0
# How far from the middle of its texel the bottom of a valley may be: it lies in one texel alone.
_NEAREST = 0.5
# How many standard deviations of noise a line is above it.
_NOISES = 4.5
# Texels of a side that are looked at together, without what is around them.
TILE = 1024
APRON = int(np.ceil(_TRUNCATED * SCALES[-1]))
# Texels around a tile whose answers are looked at, too, so that neighbours of its own are known.
_AROUND = 1
# Texels of a side of a block whose noise is measured, and the share of the blocks that are quieter:
# lines are fewer there.
_BLOCK, _QUIETER = 16, 0.2
# The median of the magnitudes of a normal distribution.
_MEDIAN = 0.6745


@dataclass(frozen=True, eq=False)
class ValleyPoints:
    """K places at the bottom of valleys, one in a texel, by row and column.

    x, y (K,): texels from the middle of the first texel, y down.  column, row (K,) int64: the
    texel.  along (K, 2): unit vector along the valley.  scale (K,): texels.  curvature (K,):
    across, of the relief smoothed at that scale, relief per texel squared.
    """

    x: Floats
    y: Floats
    column: NDArray[np.int64]
    row: NDArray[np.int64]
    along: Floats
    scale: Floats
    curvature: Floats

    def __len__(self) -> int:
        return len(self.x)

    def take(self, rows: NDArray[Any]) -> ValleyPoints:
        """The points of an index or a mask, in its order."""
        return taken(self, rows)


@dataclass(frozen=True, eq=False)
class Pits:
    """K pits. x, y, scale (K,): as of ValleyPoints.  curvature (K, 2): the smaller and the larger.
    angle (K,): of the larger curvature, from x towards y."""

    x: Floats
    y: Floats
    scale: Floats
    curvature: Floats
    angle: Floats

    def __len__(self) -> int:
        return len(self.x)

    def take(self, rows: NDArray[Any]) -> Pits:
        """The pits of an index or a mask, in its order."""
        return taken(self, rows)


@dataclass(frozen=True)
class Limits:
    """What counts. faint: the least curvature times the square of its scale, relief units, that is
    no line, beside `noise`, the standard deviation of noise from texel to texel.  round_from: the
    least ratio of the curvatures of a pit.  line_scales: of SCALES, those of lines."""

    faint: float
    noise: float = 0.0
    round_from: float = 0.2
    line_scales: tuple[float, ...] = LINE_SCALES

    def at(self, scale: Floats) -> Floats:
        """The least curvature at a scale, relief per texel squared. Curvature of white noise after
        a Gaussian has the standard deviation noise · √(3/(16π)) / scale³."""
        least: Floats = np.maximum(
            self.faint / scale**2, _NOISES * self.noise * (3 / (16 * np.pi)) ** 0.5 / scale**3
        )
        return least


def find_ridges(
    work: Workspace,
    relief: NDArray[np.float32],
    inside: NDArray[np.bool_],
    limits: Limits,
    tile: int = TILE,
    progress: Progress = silent,
) -> tuple[ValleyPoints, Pits]:
    """The valley lines and the pits of a map, row by row.

    relief (H, W).  inside (H, W): where there is skin. Nothing is found elsewhere, and what the map
    has there is read only within the reach of the smoothing.
    """
    tiles = list(_tiles(relief.shape, tile))
    found = []
    for done, (top, left, height, width) in enumerate(tiles):
        progress(done / len(tiles), "lines")
        if inside[top : top + height, left : left + width].any():
            padded = _padded(relief, top, left, height, width)
            lines, pits = _answers(work, padded, height, width, limits.line_scales)
            skin = _padded(inside, top, left, height, width)[APRON:-APRON, APRON:]
            skin = skin[:, : width + 2 * _AROUND]
            corner = top, left
            found.append((_valleys(lines, skin, limits, corner), _pits(pits, skin, limits, corner)))
    nothing = np.zeros((4, 2, 2), np.float32), np.zeros((2, 2), np.bool_), limits, (0, 0)
    found.append((_valleys(*nothing), _pits(*nothing)))
    points = joined([valleys for valleys, _ in found])
    pits_ = joined([pits for _, pits in found])
    order = np.argsort(points.row * relief.shape[1] + points.column, kind="stable")
    return points.take(order), pits_.take(np.lexsort((pits_.x, pits_.y)))


def _tiles(shape: tuple[int, ...], tile: int) -> Iterator[tuple[int, int, int, int]]:
    for top in range(0, shape[0], tile):
        for left in range(0, shape[1], tile):
            yield top, left, min(tile, shape[0] - top), min(tile, shape[1] - left)


def _padded(array: NDArray[Any], top: int, left: int, height: int, width: int) -> NDArray[Any]:
    """A tile with APRON + _AROUND texels around it, and to its right as much more as vectors take;
    beyond the map its border goes on."""
    margin = APRON + _AROUND
    wide = _whole_vectors(width + 2 * _AROUND) + 2 * APRON
    rows = np.clip(np.arange(top - margin, top + height + margin), 0, array.shape[0] - 1)
    columns = np.clip(np.arange(left - margin, left - margin + wide), 0, array.shape[1] - 1)
    return array[rows[:, None], columns]


def _answers(
    work: Workspace,
    padded: NDArray[np.float32],
    height: int,
    width: int,
    line_scales: tuple[float, ...],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(4, height + 2, width + 2) each: `lines` and `pits` of ridges.cl, of a tile and around it.

    padded: of `_padded`.
    """
    rows, columns = height + 2 * _AROUND, _whole_vectors(width + 2 * _AROUND)
    with work.nested() as nested:
        relief = nested.upload(padded)
        planes = nested.empty(3 * padded.shape[0] * columns, np.float32)
        lines, pits = (nested.full(4 * rows * columns, np.float32(0)) for _ in range(2))
        for scale in SCALES:
            taps, radius = gaussian_taps(scale)
            weights = nested.upload(taps.astype(np.float32))
            nested.run(
                "ridges", "rows_of_relief", padded.shape[0] * columns // VECTOR,
                relief, padded.shape[1], columns, APRON, radius, weights, planes,
            )  # fmt: skip
            share = scale**LINE_POWER if scale in line_scales else 0.0
            nested.run(
                "ridges", "ridges_at_scale", rows * columns // VECTOR,
                planes, padded.shape[0], columns, APRON, radius, weights, float(scale),
                float(share), float(scale**PIT_POWER), lines, pits,
            )  # fmt: skip
        shape = (4, rows, columns)
        of_lines, of_pits = (nested.read(b, shape, np.float32) for b in (lines, pits))
        return of_lines[..., : width + 2 * _AROUND], of_pits[..., : width + 2 * _AROUND]


def _whole_vectors(texels: int) -> int:
    return -(-texels // VECTOR) * VECTOR


def gaussian_taps(scale: float) -> tuple[Floats, int]:
    """(3, 2 radius + 1) a Gaussian and its first two derivatives, in the order in which a sum over
    neighbours takes them, and the radius. The sums are exact for parabolas."""
    radius = int(np.ceil(_TRUNCATED * scale))
    k = np.arange(-radius, radius + 1, dtype=np.float64)
    even = np.exp(-0.5 * (k / scale) ** 2)
    even /= even.sum()
    once = k * even
    once /= (once * k).sum()
    twice = (k**2 / scale**2 - 1.0) * even
    twice -= even * twice.sum()
    twice *= 2.0 / (twice * k**2).sum()
    return np.stack([even, once, twice]), radius


def _valleys(
    answers: NDArray[np.float32],
    skin: NDArray[np.bool_],
    limits: Limits,
    corner: tuple[int, int],
) -> ValleyPoints:
    """The valley points of a tile at a corner (row, column), from its answers with one texel around
    it."""
    own = answers[:, _AROUND:-_AROUND, _AROUND:-_AROUND]
    there = skin[_AROUND:-_AROUND, _AROUND:-_AROUND] & (own[0] > 0.0)
    row, column = np.nonzero(there & (np.abs(own[2]) <= 2.0 * _NEAREST))
    strength, angle, way, scale = own[:, row, column].astype(np.float64)
    curvature = strength / scale**LINE_POWER
    here = np.flatnonzero(curvature > limits.at(scale))
    row, column, angle, way, scale, curvature = (
        values[here] for values in (row, column, angle, way, scale, curvature)
    )
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    off = way[:, None] * across
    here = np.abs(off).max(axis=1, initial=0.0) <= _NEAREST
    row, column, off, across = row[here], column[here], off[here], across[here]
    along = np.stack([-across[:, 1], across[:, 0]], axis=1)
    row, column = row + corner[0], column + corner[1]  # before the way, which would round otherwise
    x, y = column + off[:, 0], row + off[:, 1]
    return ValleyPoints(x, y, column, row, along, scale[here], curvature[here])


def _pits(
    answers: NDArray[np.float32],
    skin: NDArray[np.bool_],
    limits: Limits,
    corner: tuple[int, int],
) -> Pits:
    """The pits of a tile at a corner (row, column): texels that answer more than those around them.
    Where two answer the same the first counts."""
    strength = np.where(skin, answers[0], np.float32(0.0))
    own = strength[_AROUND:-_AROUND, _AROUND:-_AROUND]
    most = own > 0
    height, width = own.shape
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            other = strength[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
            if (dy, dx) < (0, 0):
                most &= own > other
            elif (dy, dx) > (0, 0):
                most &= own >= other
    row, column = np.nonzero(most)
    chosen = answers[:, row + _AROUND, column + _AROUND].astype(np.float64)
    row, column = row + corner[0], column + corner[1]
    strongest, angle, ratio, scale = chosen
    smaller = strongest / scale**PIT_POWER
    kept = (ratio >= limits.round_from) & (smaller > limits.at(scale))
    curvature = np.stack([smaller, smaller / np.maximum(ratio, 1e-6)], axis=1)
    found = Pits(column.astype(np.float64), row.astype(np.float64), scale, curvature, angle)
    return found.take(kept)


def noise_of(relief: NDArray[np.float32], inside: NDArray[np.bool_]) -> float:
    """The standard deviation of noise that is independent from texel to texel, relief units: that
    of the diagonal difference of each two by two texels (Donoho and Johnstone 1994), of the
    quietest blocks, for lines count there as noise does. 0 where no block is full.

    relief (H, W).  inside (H, W): where there is skin.
    """
    height, width = (side // _BLOCK * _BLOCK for side in relief.shape)
    r = relief[:height, :width]
    whole = inside[:height, :width]
    a, b, c, d = (r[y::2, x::2] for y in (0, 1) for x in (0, 1))
    half = _BLOCK // 2
    blocks = _in_blocks(0.5 * np.abs(a - b - c + d), half)
    full = _in_blocks(whole, _BLOCK).all(axis=1)
    if not full.any():
        return 0.0
    return float(np.quantile(np.median(blocks[full], axis=1), _QUIETER) / _MEDIAN)


def _in_blocks(values: NDArray[Any], side: int) -> NDArray[Any]:
    """(B, side²) the values of each block of a map."""
    rows, columns = (size // side for size in values.shape)
    cut = values.reshape(rows, side, columns, side).swapaxes(1, 2)
    found: NDArray[Any] = cut.reshape(rows * columns, side * side)
    return found
