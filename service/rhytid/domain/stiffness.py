"""How much of its stretch the skin follows: painted maps, 1 is the paper, 0 is rigid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.arrays import fixed_array
from rhytid.domain.tiles import texel_centres
from rhytid.errors import InputError, LimitError

# Of all maps together: 8192² twice, or 4096² eight times.
MOST_TEXELS = 2**27


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Maps (h, w) float32 from 0 to 1 by UDIM, which log stretch is multiplied by once it is
    clamped; a UDIM without a map is 1 throughout. Of any size, square or not.

    Row 0 is the top: texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h.
    Between centres a map is bilinear, beyond the outermost it goes on as they are. Raises
    InputError naming the map that cannot be used, LimitError above MOST_TEXELS in all.
    """

    maps: Mapping[int, NDArray[np.float32]]

    def __post_init__(self) -> None:
        fixed = {}
        for udim, map in sorted(self.maps.items()):
            what = f"stiffness of UDIM {udim}"
            fixed[udim] = fixed_array(map, what, (None, None), np.float32, InputError)
            if fixed[udim].size == 0 or not ((fixed[udim] >= 0) & (fixed[udim] <= 1)).all():
                raise InputError(f"{what}: numbers from 0 to 1, at least one")
        total = sum(map.size for map in fixed.values())
        if total > MOST_TEXELS:
            raise LimitError(f"stiffness maps of {total} texels in all: at most {MOST_TEXELS}")
        object.__setattr__(self, "maps", fixed)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The maps by the UDIM as text."""
        return {str(udim): map for udim, map in self.maps.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[np.float32]]) -> Stiffness:
        """The inverse of `arrays`."""
        return cls({int(udim): map for udim, map in arrays.items()})

    def check_udims(self, udims: Sequence[int]) -> None:
        """Raise InputError for a map of a UDIM that is not among those of the mesh."""
        for udim in self.maps:
            if udim not in udims:
                have = ", ".join(str(known) for known in udims)
                raise InputError(f"stiffness of UDIM {udim}: it has no mesh; the mesh has {have}")

    def at(self, udim: int, local: NDArray[np.floating]) -> NDArray[np.float32]:
        """(P,) at points (P, 2) in UV local to the UDIM."""
        map = self.maps.get(udim)
        if map is None:
            return np.ones(len(local), np.float32)
        left, right, x = _between(local[:, 0], map.shape[1])
        top, bottom, y = _between(1.0 - local[:, 1].astype(np.float64), map.shape[0])
        upper = _mix(map[top, left], map[top, right], x)
        return _mix(upper, _mix(map[bottom, left], map[bottom, right], x), y)

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
        rows = [_mix(map[i][:, left], map[i][:, right], x) for i in (top, bottom)]
        found = _mix(rows[0], rows[1], y[:, None])
        return None if (found == 1).all() else found


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
