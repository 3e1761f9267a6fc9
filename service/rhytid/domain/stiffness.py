"""How much of its stretch the skin follows: painted maps, 1 is the paper, 0 is rigid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted import (
    between,
    bilinear,
    check_total,
    check_udim,
    fixed_map,
    mix,
    shares,
)
from rhytid.domain.tiles import texel_centres

# Plain skin; also the value where there is no map.
NEUTRAL = 1.0


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
            fixed[udim] = fixed_map(map, what)
            check_total(fixed.values(), what, "stiffness")
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
            return np.full(len(local), NEUTRAL, np.float32)
        return bilinear(map, local)

    def texels(
        self, udim: int, side: int, row: int, column: int, count: int
    ) -> NDArray[np.float32] | None:
        """(count, count) at the texel centres of a level of `side` texels, from (row, column) on.

        None where all of them are 1.
        """
        map = self.maps.get(udim)
        if map is None:
            return None
        left, right, x = between(texel_centres(column, count, side), map.shape[1])
        top, bottom, y = between(texel_centres(row, count, side), map.shape[0])
        rows = [mix(shares(map[i][:, left]), shares(map[i][:, right]), x) for i in (top, bottom)]
        found = mix(rows[0], rows[1], y[:, None])
        return None if (found == NEUTRAL).all() else found
