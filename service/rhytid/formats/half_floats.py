"""Half floats of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# The first float32 that rounds to no half float.
OVERFLOW = 65520.0
# The code of the negative zero.
_NEGATIVE = 0x8000
# Numbers that are converted at a time: what is in between stays in the cache.
_PIECE = 1 << 15
_EXPONENT, _SIGN = np.uint32(0x7F800000), np.uint32(0x8000)
# Bits of a float32 whose exponent is that of the least half float that is normal, and how much
# larger the exponent of the power of two is.
_LEAST, _LARGER = np.uint32(113 << 23), np.uint32(13 << 23)
# Bits of a mantissa that a half float lacks; what the exponent of the power of two is too large by.
_LACKS, _OFFSET = np.uint32(13), np.uint32(126 << 10)


def half_floats(values: NDArray[np.float32]) -> NDArray[np.float16]:
    """Half floats of numbers, each below OVERFLOW, rounded as numpy does, in half of its time.

    numpy converts one number after the other. Here a number is added to the power of two whose last
    bit is that of its half float: the addition of floats rounds to even by itself.
    """
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    out = np.empty(values.shape, "<u2")
    codes, piece = out.reshape(-1), min(_PIECE, len(flat))
    room = np.empty((3, piece), np.uint32)
    least = np.full(piece, _LEAST)  # numpy compares two arrays faster than one and a number
    for first in range(0, len(flat), _PIECE):
        some = flat[first : first + piece]
        _convert(some, room[:, : len(some)], least[: len(some)], codes[first : first + piece])
    return out.view("<f2")


def _convert(some: NDArray[np.float32], room: Any, least: Any, codes: Any) -> None:
    """Half floats of `some` as `codes`.  room: (3, n), overwritten."""
    bits, (power, rounded, sign) = some.view(np.uint32), room
    sums = rounded.view(np.float32)
    np.bitwise_and(bits, _EXPONENT, out=power)
    np.maximum(power, least, out=power)
    np.add(power, _LARGER, out=power)
    np.abs(some, out=sums)
    np.add(sums, power.view(np.float32), out=sums)
    # What the addition left of the mantissa, and the exponent: of a number that was rounded up to a
    # power of two the one overflows into the other.
    np.subtract(rounded, power, out=rounded)
    np.right_shift(power, _LACKS, out=power)
    np.add(rounded, power, out=rounded)
    np.subtract(rounded, _OFFSET, out=rounded)
    np.right_shift(bits, np.uint32(16), out=sign)
    np.bitwise_and(sign, _SIGN, out=sign)
    np.bitwise_or(rounded, sign, out=rounded)
    np.copyto(codes, rounded, casting="unsafe")


def extremes(halves: NDArray[np.float16]) -> tuple[np.float16, np.float16]:
    """The least and the greatest of half floats that are all numbers, by their codes: numpy
    converts each of them to compare it, which takes ten times as long."""
    codes = halves.view("<u2")
    low, high = codes.max(), halves.view("<i2").max().astype("<u2")
    if low < _NEGATIVE:  # none has a sign, so that codes ascend as the numbers do
        low = codes.min()
    if high >= _NEGATIVE:  # all have one
        high = codes.min()
    return low.view(np.float16), high.view(np.float16)
