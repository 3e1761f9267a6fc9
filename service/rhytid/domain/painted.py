"""Maps painted in UV: what they must satisfy, and their values between texel centres.

Row 0 is the top: texel (row, column) of a map (h, w) has its centre at u = (column + ½)/w,
v = 1 − (row + ½)/h. Between centres a map is bilinear, beyond the outermost it goes on as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.arrays import fixed_array
from rhytid.errors import InputError, LimitError

Map = NDArray[np.float32]
# Of all maps of a kind together: 8192² twice, or 4096² eight times.
MOST_TEXELS = 2**27


def checked_maps(maps: Mapping[int, Map], what: str) -> dict[int, Map]:
    """Copies (h, w) float32 by UDIM that do not change; raises InputError for what is no map of
    numbers from 0 to 1."""
    fixed = {}
    for udim, map in sorted(maps.items()):
        name = f"{what} of UDIM {udim}"
        fixed[udim] = fixed_array(map, name, (None, None), np.float32, InputError)
        if fixed[udim].size == 0 or not ((fixed[udim] >= 0) & (fixed[udim] <= 1)).all():
            raise InputError(f"{name}: numbers from 0 to 1, at least one")
    return fixed


def check_texels(maps: Iterable[Map], what: str) -> None:
    """Raise LimitError above MOST_TEXELS in all."""
    total = sum(map.size for map in maps)
    if total > MOST_TEXELS:
        raise LimitError(f"{what} maps of {total} texels in all: at most {MOST_TEXELS}")


def check_udims(maps: Iterable[int], udims: Sequence[int], what: str) -> None:
    """Raise InputError for a map of a UDIM that is not among those of the mesh."""
    for udim in maps:
        if udim not in udims:
            have = ", ".join(str(known) for known in udims)
            raise InputError(f"{what} of UDIM {udim}: it has no mesh; the mesh has {have}")


def bilinear(map: Map, local: NDArray[np.floating]) -> Map:
    """(P,) at points (P, 2) in UV local to the UDIM of the map."""
    left, right, x = between(local[:, 0], map.shape[1])
    top, bottom, y = between(1.0 - local[:, 1].astype(np.float64), map.shape[0])
    upper = mix(map[top, left], map[top, right], x)
    return mix(upper, mix(map[bottom, left], map[bottom, right], x), y)


def between(
    share: NDArray[np.floating], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """The texels on both sides of points at a share of the way over `size` texels, and how far
    from the first to the second the points are."""
    place = np.clip(share.astype(np.float64) * size - 0.5, 0.0, size - 1.0)
    first = np.floor(place).astype(np.int64)
    return first, np.minimum(first + 1, size - 1), (place - first).astype(np.float32)


def mix(one: Map, other: Map, share: Map) -> Map:
    """From `one` to `other`; of equals exactly themselves."""
    mixed: Map = one + share * (other - one)
    return mixed
