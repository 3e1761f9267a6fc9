"""How much of its stretch the skin follows: painted maps, 1 is the paper, 0 is rigid."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.arrays import fixed_array
from rhytid.domain.tiles import texel_centres
from rhytid.errors import InputError, LimitError

# Of all maps together: 8192² twice, or 4096² eight times.
MOST_TEXELS = 2**27
# 65535/255: a code of 16 bits that is such a multiple is the same share as a code of 8 bits.
_CODES_A_BYTE = 257


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Maps (h, w) from 0 to 1 by UDIM, which log stretch is multiplied by once it is clamped; a
    UDIM without a map is 1 throughout. Of any size, square or not. Each is uint8 or uint16 codes of
    which the largest is 1, and stays so, in 8 bits where they are enough; or floats, kept as
    float32.

    Row 0 is the top: texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h.
    Between centres a map is bilinear, beyond the outermost it goes on as they are. Raises
    InputError naming the map that cannot be used, LimitError above MOST_TEXELS in all.
    """

    maps: Mapping[int, NDArray[Any]]

    def __post_init__(self) -> None:
        fixed: dict[int, NDArray[Any]] = {}
        for udim, map in sorted(self.maps.items()):
            what = f"stiffness of UDIM {udim}"
            fixed[udim] = _fixed(map, what)
            check_total(fixed.values(), what)
        object.__setattr__(self, "maps", fixed)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The maps by the UDIM as text."""
        return {str(udim): map for udim, map in self.maps.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Stiffness:
        """The inverse of `arrays`."""
        return cls({int(udim): map for udim, map in arrays.items()})

    def check_udims(self, udims: Sequence[int]) -> None:
        """Raise InputError for a map of a UDIM that is not among those of the mesh."""
        for udim in self.maps:
            check_udim(udim, udims, "a stiffness map")

    def at(self, udim: int, local: NDArray[np.floating]) -> NDArray[np.float32]:
        """(P,) at points (P, 2) in UV local to the UDIM."""
        map = self.maps.get(udim)
        if map is None:
            return np.ones(len(local), np.float32)
        left, right, x = _between(local[:, 0], map.shape[1])
        top, bottom, y = _between(1.0 - local[:, 1].astype(np.float64), map.shape[0])
        rows = [_mix(_shares(map[i, left]), _shares(map[i, right]), x) for i in (top, bottom)]
        return _mix(rows[0], rows[1], y)

    def texels(
        self, udim: int, side: int, row: int, column: int, count: int
    ) -> NDArray[np.float32] | None:
        """(count, count) at the texel centres of a level of `side` texels, from (row, column) on.

        None where all of them are 1.
        """
        map = self.maps.get(udim)
        if map is None:
            return None
        left, right, x = _between(texel_centres(column, count, side), map.shape[1])
        top, bottom, y = _between(texel_centres(row, count, side), map.shape[0])
        rows = [_mix(_shares(map[i][:, left]), _shares(map[i][:, right]), x) for i in (top, bottom)]
        found = _mix(rows[0], rows[1], y[:, None])
        return None if (found == 1).all() else found


def check_udim(udim: int, udims: Sequence[int], what: str) -> None:
    """Raise InputError where the UDIM of `what` is not among those of the mesh."""
    if udim not in udims:
        have = ", ".join(str(known) for known in udims)
        raise InputError(f"{what} is of UDIM {udim}, which has no mesh; the mesh has {have}")


def check_total(maps: Iterable[NDArray[Any]], what: str) -> None:
    """Raise LimitError where maps, of which `what` is the last, exceed MOST_TEXELS together."""
    total = sum(map.size for map in maps)
    if total > MOST_TEXELS:
        rule = f"at most {MOST_TEXELS}"
        raise LimitError(f"{what}: stiffness maps up to it have {total} texels in all: {rule}")


def _fixed(map: NDArray[Any], what: str) -> NDArray[Any]:
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


def _shares(texels: NDArray[Any]) -> NDArray[np.float32]:
    """Codes as shares of the largest; floats as they are."""
    shares: NDArray[np.float32] = texels.astype(np.float32, copy=False)
    return shares if texels.dtype.kind == "f" else shares / np.float32(np.iinfo(texels.dtype).max)


def _between(
    share: NDArray[np.floating], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """The texels on both sides of points at a share of the way over `size` texels, and how far
    from the first to the second the points are."""
    place = np.clip(share.astype(np.float64) * size - 0.5, 0.0, size - 1.0)
    first = np.floor(place).astype(np.int64)
    return first, np.minimum(first + 1, size - 1), (place - first).astype(np.float32)


def _mix(
    one: NDArray[np.float32], other: NDArray[np.float32], share: NDArray[np.float32]
) -> NDArray[np.float32]:
    mixed: NDArray[np.float32] = one + share * (other - one)  # of equals exactly themselves
    return mixed
