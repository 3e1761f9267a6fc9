"""Spectra of reliefs, of blocks of texels that lie within charts: how high waves of each length
are, and where a map ends, below which it has none of its own though its texels would carry them.

A block is 32 or 64 texels a side, less its mean, under the window of Hann; its squares are those of
its Fourier transform by Parseval, so that all waves together have the variance of the block.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.floating[Any]] | NDArray[np.unsignedinteger[Any]]
Inside = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
# Texels a side of a block where waves are told apart by place, and where all blocks are one.
PLACED, WHOLE = 32, 64
# The least slope of the density of a map, as a power of the number of waves, to which it is taken
# to go on. Skin that rhytid grows falls by 2.4 to 5.3, a light stage's by 2.2 to 4.8; what was
# enlarged four times, or blurred by two texels, by 10 and more where it ends.
_ENDS = -7.0
# Of the slope, in octaves: the places where it is taken, and how far it reaches to each side.
_APART, _REACH = 0.25, 0.25
# Rows of blocks, at most twice as many, of which an end is found.
_MOST_ROWS = 32
# The number of waves to a block from which on an end is looked for.
_FIRST = 3


def band_squares(
    map: Map, inside: Inside, bands: Sequence[tuple[float, float]]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """(K, B, B) the mean square of the waves of each band in blocks of PLACED texels, and (B, B)
    which blocks lie inside; B whole ones along a side, others are 0.

    map (H, H).  inside (H, H): texels of charts.  bands: the shortest and the longest waves of
    each, texels.
    """
    count = len(map) // PLACED
    found, known = np.zeros((len(bands), count, count)), np.zeros((count, count), np.bool_)
    waves = _waves(PLACED)
    shares = [
        (waves > PLACED / longest) & (waves <= PLACED / shortest) for shortest, longest in bands
    ]
    for row, (whole, squares) in enumerate(_rows(map, inside, PLACED)):
        known[row] = whole
        for band, share in enumerate(shares):
            found[band, row, whole] = squares[:, share].sum(axis=1)
    return found, known


def shortest_wave(map: Map, inside: Inside) -> float | None:
    """The wave, in texels, from which on the spectrum falls away, longer than two texels; None
    where it goes on to the last, or where no block of WHOLE texels lies inside.

    map (H, W).  inside (H, W): texels of charts.
    """
    total, count = np.zeros((WHOLE, WHOLE)), 0
    # Of large maps some rows of blocks tell enough.
    for _, squares in _rows(map, inside, WHOLE, max(len(map) // (WHOLE * _MOST_ROWS), 1)):
        total += squares.sum(axis=0)
        count += len(squares)
    ring = np.rint(_waves(WHOLE)).astype(np.int64)
    sums, sizes = np.bincount(ring.ravel(), total.ravel()), np.bincount(ring.ravel())
    density = (sums / sizes)[1 : WHOLE // 2 + 1]
    if count == 0 or density.min() <= 0.0:
        return None
    waves = np.arange(1, WHOLE // 2 + 1)
    at = np.arange(np.log2(_FIRST), np.log2(waves[-1]) - _REACH, _APART)
    high, low = (np.interp(at + way, np.log2(waves), np.log2(density)) for way in (_REACH, -_REACH))
    steep = np.flatnonzero((high - low) / (2.0 * _REACH) < _ENDS)
    return float(WHOLE / 2.0 ** at[steep[0]]) if steep.size else None


def _waves(side: int) -> FloatArray:
    """(side, side) waves to a block of each term of its transform."""
    along = np.fft.fftfreq(side, 1.0 / side)
    found: FloatArray = np.hypot(along[:, None], along)
    return found


def _rows(
    map: Map, inside: Inside, side: int, every: int = 1
) -> Iterator[tuple[NDArray[np.bool_], FloatArray]]:
    """Of every so many rows of blocks which of them lie inside, and (K, side, side) the squares of
    these."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(side) / side)
    weight = window[:, None] * window
    scale = side**-4.0 / np.mean(weight**2)
    columns = map.shape[1] // side
    for top in range(0, map.shape[0] // side * side, side * every):
        part = slice(top, top + side), slice(0, columns * side)
        whole = np.all(inside[part].reshape(side, columns, side), axis=(0, 2))
        blocks = np.swapaxes(map[part].reshape(side, columns, side), 0, 1)[whole].astype(np.float64)
        blocks -= blocks.mean(axis=(1, 2), keepdims=True)
        yield whole, np.abs(np.fft.fft2(blocks * weight)) ** 2 * scale
