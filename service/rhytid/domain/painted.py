"""Maps painted in UV: what they must satisfy, and their values between texel centres.

A map (h, w) of any size, square or not, holds uint8 or uint16 codes of which the largest is 1, and
stays so, in 8 bits where they are enough; or floats from 0 to 1, kept as float32. Row 0 is the top:
texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h. Between centres a map
is bilinear, beyond the outermost it goes on as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.validation import fixed_array
from rhytid.errors import InputError, LimitError

Map = NDArray[Any]
Shares = NDArray[np.float32]
# Of all maps of a kind together: 8192² twice, or 4096² eight times.
MOST_TEXELS = 2**27
# 65535/255: a code of 16 bits that is such a multiple is the same share as a code of 8 bits.
_CODES_A_BYTE = 257


def fixed_map(map: Map, what: str) -> Map:
    """A copy that does not change; raises InputError naming `what` for what is no map."""
    dtype = np.asarray(map).dtype
    coded = dtype.kind == "u" and dtype.itemsize <= 2
    kept = np.dtype(f"u{dtype.itemsize}" if coded else np.float32)
    fixed = fixed_array(map, what, (None, None), kept, InputError)
    if fixed.size == 0 or not (coded or ((fixed >= 0) & (fixed <= 1)).all()):
        raise InputError(f"{what}: numbers from 0 to 1, at least one")
    if kept != np.uint16 or (fixed % _CODES_A_BYTE).any():
        return fixed
    narrow = (fixed // _CODES_A_BYTE).astype(np.uint8)
    narrow.setflags(write=False)
    return narrow


def check_total(maps: Iterable[Map], what: str, kind: str) -> None:
    """Raise LimitError where maps, of which `what` is the last, exceed MOST_TEXELS together."""
    total = sum(map.size for map in maps)
    if total > MOST_TEXELS:
        rule = f"at most {MOST_TEXELS}"
        raise LimitError(f"{what}: {kind} maps up to it have {total} texels in all: {rule}")


def check_udim(udim: int, udims: Sequence[int], what: str) -> None:
    """Raise InputError where the UDIM of `what` is not among those of the mesh."""
    if udim not in udims:
        have = ", ".join(str(known) for known in udims)
        raise InputError(f"{what} is of UDIM {udim}, which has no mesh; the mesh has {have}")


def shares(texels: Map) -> Shares:
    """Codes as shares of the largest; floats as they are."""
    found: Shares = texels.astype(np.float32, copy=False)
    return found if texels.dtype.kind == "f" else found / np.float32(np.iinfo(texels.dtype).max)


def bilinear(
    map: Map, local: NDArray[np.floating], meaning: Callable[[Map], Shares] = shares
) -> Shares:
    """(P,) at points (P, 2) in UV local to the UDIM of the map, between what texels mean."""
    left, right, x = between(local[:, 0], map.shape[1])
    top, bottom, y = between(1.0 - local[:, 1].astype(np.float64), map.shape[0])
    rows = [mix(meaning(map[i, left]), meaning(map[i, right]), x) for i in (top, bottom)]
    return mix(rows[0], rows[1], y)


def between(
    share: NDArray[np.floating], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Shares]:
    """The texels on both sides of points at a share of the way over `size` texels, and how far
    from the first to the second the points are."""
    place = np.clip(share.astype(np.float64) * size - 0.5, 0.0, size - 1.0)
    first = np.floor(place).astype(np.int64)
    return first, np.minimum(first + 1, size - 1), (place - first).astype(np.float32)


def mix(one: Shares, other: Shares, share: Shares) -> Shares:
    """From `one` to `other`; of equals exactly themselves."""
    mixed: Shares = one + share * (other - one)
    return mixed
