"""Measures of scans and of what was traced of them: the fine part of a relief, the depth that lines
are drawn with, and how much of a relief is left."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.warnings import LINES_LEFT, SCAN_LINES, InputWarning
from rhytid.pipeline.vectors import VECTOR
from rhytid.synthesis.workspace import Workspace

Relief = NDArray[np.float32]
Inside = NDArray[np.bool_]
Beyond = Literal["constant", "edge"]
# Texels of a side of the mean that the fine part is without.
BROAD = 33
# The same where lines with a broad layer are looked for. That layer is as broad as swells of skin,
# and hides faint lines beside deep ones; with 9 and 13 fewer of those of grown skin were found.
NARROW = 5
# The share of the texels of charts that lie less deep than a line of weight 1.
_DEEPEST = 0.999
# Texels of a side of a map whose means are taken together.
_TILE = 1024


def fine_part(work: Workspace, relief: Relief, inside: Inside) -> Relief:
    """The relief (H, W) less its mean around each texel, over what is inside (H, W); 0 outside."""
    shares = inside.astype(np.float32)
    shares -= above_mean(work, shares, BROAD, "constant")
    fine = np.where(inside, relief, np.float32(0.0))
    fine -= (fine - above_mean(work, fine, BROAD, "constant")) / np.maximum(
        shares, np.float32(1e-6)
    )
    fine *= inside
    return fine


def depth_of(fine: Relief, inside: Inside) -> float:
    """The depth of a line of weight 1, relief units: that of the deepest thousandth of the texels
    inside, in their fine part. Weights are 1 at most, and what is deeper stays in the residual. 0
    where there is no relief."""
    if not inside.any():
        return 0.0
    values, share = fine[inside], 1.0 - _DEEPEST
    place = share * (len(values) - 1)
    low = int(place)
    high = min(low + 1, len(values) - 1)
    # As `np.quantile` has it, which takes several times as long.
    values.partition([low, high])
    deep = values[low] + (place - low) * (values[high] - values[low])
    return max(-float(deep), 0.0)


def spread(values: Relief, inside: Inside) -> float:
    """The root mean square of values (H, W) inside about their mean, for a midlevel that is off is
    no relief; 0 where nothing is."""
    return float(np.std(values[inside], dtype=np.float64)) if inside.any() else 0.0


def rms_of_some(values: Relief, count: int) -> float:
    """The root mean square of `count` values of a map (H, W) whose others are 0; 0 where there are
    none."""
    rows = np.einsum("ij,ij->i", values, values).astype(np.float64)
    return float(np.sqrt(rows.sum() / count)) if count else 0.0


@dataclass(frozen=True)
class Left:
    """How much traced lines and pores leave of the relief of a UDIM.

    relief, fine: root mean squares of the relief and of its fine part about their means, mesh
    units.  left, fine_left: shares of these that are left.
    """

    relief: float
    left: float
    fine: float
    fine_left: float

    @classmethod
    def of(cls, work: Workspace, relief: Relief, residual: Relief, inside: Inside) -> Left:
        """Of maps (H, W); inside (H, W): their charts."""
        whole, left = spread(relief, inside), spread(residual, inside)
        fine, fine_left = (
            spread(fine_part(work, map, inside), inside) for map in (relief, residual)
        )
        return cls(whole, left / whole if whole else 0.0, fine, fine_left / fine if fine else 0.0)

    def warnings(self, udim: int) -> Iterator[InputWarning]:
        """scan-lines, where lines and pores explain next to nothing."""
        if self.fine_left > LINES_LEFT or self.left >= 1.0:
            detail = (
                f"lines and pores leave {100 * self.fine_left:.0f} % of the relief that is "
                f"narrower than {BROAD} texels, and {100 * self.left:.0f} % of all of it: hardly "
                "anything will move"
            )
            yield InputWarning(SCAN_LINES, detail, f"UDIM {udim}")


def above_mean(work: Workspace, values: Relief, side: int, beyond: Beyond = "edge") -> Relief:
    """(H, W) what a map is above its mean around each texel, of a nearly Gaussian weight: that over
    `side` texels, twice. Kernel: means.cl.

    beyond: how the map goes on beyond its border, as NumPy pads arrays.
    """
    found, radius = np.empty_like(values), side - 1
    for top in range(0, values.shape[0], _TILE):
        for left in range(0, values.shape[1], _TILE):
            own = values[top : top + _TILE, left : left + _TILE]
            height, width = own.shape[0], -(-own.shape[1] // VECTOR) * VECTOR
            corner, size = (top - radius, left - radius), (height + 2 * radius, width + 2 * radius)
            padded = cut_out(values, corner, size, beyond)
            with work.nested() as nested:
                above = above_mean_of_tile(nested, padded, (height, width), side)
                tile = nested.read(above, (height, width), np.float32)
            found[top : top + height, left : left + own.shape[1]] = tile[:, : own.shape[1]]
    return found


def above_mean_of_tile(
    work: Workspace,
    padded: Relief,
    shape: tuple[int, int],
    side: int | None,
    factor: float = 1.0,
) -> Buffer:
    """What a tile is above its mean over `side` texels, or above 0, times a factor.

    shape: of the tile; its width is a multiple of VECTOR.  padded: it with side - 1 texels more on
    each side.
    """
    taps = np.zeros(1, np.float32) if side is None else _taps_of_mean(side)
    radius, (rows, columns) = len(taps) // 2, shape
    given, weights = work.upload(padded), work.upload(taps)
    means = work.empty(len(padded) * columns, np.float32)
    found = work.empty(rows * columns, np.float32)
    about = given, padded.shape[1], columns, radius, radius, weights, means
    for kernel, count, more in (
        ("means_of_rows", len(padded), ()),
        ("above_mean", rows, (factor, found)),
    ):
        work.run("means", kernel, count * columns // VECTOR, *about, *more)
    work.release(given, weights, means)
    return found


def _taps_of_mean(side: int) -> NDArray[np.float32]:
    """(2 side - 1,) the weights of `above_mean` along a row."""
    once = np.full(side, 1.0 / side)
    return np.convolve(once, once).astype(np.float32)


def cut_out(
    values: Relief,
    corner: tuple[int, int],
    shape: tuple[int, int],
    beyond: Beyond = "constant",
) -> Relief:
    """A part of a map from a corner (row, column) on, which may lie outside.

    beyond: how the map goes on beyond its border, as NumPy pads arrays.
    """
    part, more = [], []
    for first, size, side in zip(corner, shape, values.shape, strict=True):
        low, high = (min(max(end, 0), side) for end in (first, first + size))
        before = min(low - first, size) if first < 0 else 0
        part.append(slice(low, high))
        more.append((before, size - before - (high - low)))
    found: Relief = values[tuple(part)]
    if any(map(any, more)):
        found = np.pad(found, more, beyond)
    return np.ascontiguousarray(found)
