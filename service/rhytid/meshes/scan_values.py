"""What the values of a map tell, whatever its file is called: how many there are, noise, blocks of
JPEG, and how the map lies on the charts of its mesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.scan import Codes, full_range
from rhytid.domain.warnings import FLIP_MARGIN, FLIP_MATCH
from rhytid.meshes.scans import SIDE, Mask

FloatArray = NDArray[np.float64]
# Values of floats of which different ones are counted, and how often each must come to be a code.
_VALUES, _REPEATED = 1 << 18, 4
# Rows or columns that are looked at for blocks of JPEG, of this side.
_LINES, _BLOCK = 512, 8
# Of texels of a cell, along a side, that tell how much there is in it.
_TEXELS = 8
# The ways in which a map may lie turned, the likeliest first, and what undoes each.
TURNS = {
    "as it is": (0, False),
    "top to bottom": (2, True),
    "left to right": (0, True),
    "half a turn": (2, False),
    "a quarter turn": (1, False),
    "three quarter turns": (3, False),
    "a quarter turn and left to right": (1, True),
    "three quarter turns and left to right": (3, True),
}
AS_IT_IS = "as it is"
# Cells a side of masks of what is flat, for maps that have as many texels.
MASK_SIDE = 1024
# Texels on either side of what is flat: fewer are alike by chance.
_LEAST_FLAT = 4.0


def levels_of(channel: Codes) -> tuple[int | None, float, int | None]:
    """How many different values there are, the step between them, and the bits that such steps need
    over the full range, of floats over what they use.

    Of continuous floats no levels, the step of their type, and no bits.
    """
    size = full_range(channel)
    if channel.dtype.kind == "u":
        counts = np.zeros(size + 1, np.int64)
        for start in range(0, len(channel), _LINES):  # as it takes 8 bytes a texel
            part = channel[start : start + _LINES].reshape(-1)
            counts += np.bincount(part, minlength=size + 1)
        used = np.flatnonzero(counts)
        gap = int(np.gcd.reduce(np.diff(used))) if len(used) > 1 else 1
        return len(used), gap / size, (size // gap).bit_length()
    every = max(int(np.sqrt(channel.size / _VALUES)), 1)
    some = channel[::every, ::every].reshape(-1)
    values = np.unique(some).astype(np.float64)
    if len(values) * _REPEATED > len(some):
        return None, float(np.spacing(np.abs(some).max())), None
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    return len(values), step, (len(values) - 1).bit_length()


def noise_of(channel: Codes) -> float:
    """Standard deviation of what a plane through the neighbours of a texel leaves, as values.

    The mask is 1 -2 1 both ways, which no plane passes; the median of its absolute values is taken
    for that of a normal distribution (Immerkaer 1996, with a median for the mean).
    """
    height = len(channel)
    starts = np.unique(np.linspace(0, height - 3, min(_LINES, height - 2)).astype(np.int64))
    a, b, c = (channel[starts + k].astype(np.float64) for k in range(3))
    down = a - 2.0 * b + c
    both = down[:, :-2] - 2.0 * down[:, 1:-1] + down[:, 2:]
    size = np.abs(both[both != 0.0])
    return float(np.median(size)) / 0.6745 / 6.0 / full_range(channel) if size.size else 0.0


def flat_parts(relief: NDArray[np.float32], radius: float, most: float) -> NDArray[np.bool_]:
    """(MASK_SIDE, MASK_SIDE) which cells lie in squares that are flat.

    relief (H, W).  radius: half of the side of a square at least, as a share of that of the map;
    _LEAST_FLAT texels at least.
    most: how far heights in it may differ.
    """
    ends = [relief, relief]
    for axis, size in enumerate(relief.shape):
        starts = np.arange(MASK_SIDE) * size // MASK_SIDE
        # Of a map of fewer texels those come several times.
        ends = [
            ufunc.reduceat(one, starts, axis=axis)
            for ufunc, one in zip((np.minimum, np.maximum), ends, strict=True)
        ]
    radius = min(max(radius, _LEAST_FLAT / min(relief.shape)), 1.0)
    side = 2 * max(round(radius * MASK_SIDE), 1) + 1
    low = scipy.ndimage.minimum_filter(ends[0], side)
    flat = scipy.ndimage.maximum_filter(ends[1], side) - low <= most
    found: NDArray[np.bool_] = scipy.ndimage.maximum_filter(flat, side)
    return found


def blocks_of(channel: Codes) -> float:
    """The mean difference across borders of 8 x 8 texels over the median of those within, the
    larger of both directions; 1 where nothing varies."""
    return max(_blocks_along(channel), _blocks_along(channel.T))


def _blocks_along(channel: NDArray[Any]) -> float:
    rows = np.unique(np.linspace(0, len(channel) - 1, _LINES).astype(np.int64))
    steps = np.abs(np.diff(channel[rows].astype(np.float64), axis=1))
    count = steps.shape[1] // _BLOCK
    if count < _BLOCK:
        return 1.0
    mean = steps[:, : count * _BLOCK].reshape(len(rows), count, _BLOCK).mean(axis=(0, 1))
    within = float(np.median(mean[:-1]))
    return float(mean[-1]) / within if within > 0.0 else 1.0


def best_turn(channel: Codes, covered: Mask) -> str:
    """How a map must be turned for what varies in it to lie in the charts, by name in TURNS.

    covered: as `charts` has it. `as it is` where no turn is better by FLIP_MARGIN, or the map
    varies alike everywhere. Where the charts are their own mirror image, the first that fits is
    named.
    """
    amount = _amount(channel)
    middles = ((np.arange(len(amount)) + 0.5) * SIDE / len(amount)).astype(np.int64)
    inside = covered[middles[:, None], middles]
    if amount.std() == 0.0 or inside.all() or not inside.any():
        return AS_IT_IS
    fits = {name: _match(_turned(amount, *turn), inside) for name, turn in TURNS.items()}
    best = max(fits.values())
    if best < FLIP_MATCH or best - fits[AS_IT_IS] < FLIP_MARGIN:
        return AS_IT_IS
    return next(name for name, fit in fits.items() if fit > best - 0.25 * FLIP_MARGIN)


def _turned(cells: FloatArray, quarters: int, mirrored: bool) -> FloatArray:
    found = np.rot90(cells, quarters)
    return found[:, ::-1] if mirrored else found


def _match(amount: FloatArray, covered: Mask) -> float:
    return float(np.corrcoef(amount.reshape(-1), covered.reshape(-1))[0, 1])


def _amount(channel: Codes) -> FloatArray:
    """(S, S) how much a map varies within a cell, as a logarithm; cells of _TEXELS texels a side or
    more, SIDE of them at most."""
    side = max(min(SIDE, min(channel.shape) // _TEXELS), 2)
    within = np.arange(side)[:, None] + np.arange(_TEXELS) / _TEXELS
    every, columns = ((within * n / side).astype(np.int64) for n in channel.shape)
    low, high = np.full((side, side), np.inf), np.full((side, side), -np.inf)
    for rows in every.T:
        part = channel[rows[:, None, None], columns[None]].astype(np.float64)
        low, high = np.minimum(low, part.min(axis=2)), np.maximum(high, part.max(axis=2))
    found = high - low
    most = float(np.quantile(found, 0.95))
    floor = 0.5 if channel.dtype.kind == "u" else max(1e-3 * most, np.finfo(np.float64).tiny)
    amount: FloatArray = np.log(found + floor)
    return amount
