"""Maps painted in UV that guide synthesis: where there is more, deeper, wider, and which way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rhytid.domain.painted import Map, Shares, check_total, check_udim, fixed_map
from rhytid.domain.regions import REGIONS, WHOLE_FACE
from rhytid.errors import InputError

REGION_PREFIX = "region_"
REGION_MAPS = tuple(REGION_PREFIX + name for name in REGIONS if name != WHOLE_FACE)
# The grey of every map that changes nothing, from 0 (black) to 1 (white). A region of which a mask
# is painted, be it black, is not taken from expressions.
NEUTRALS = {
    "density": 0.5,
    "strength": 0.5,
    "direction": 0.0,
    "turn": 0.5,
    "anisotropy": 0.5,
    "scale": 0.5,
    "pore_radius": 0.5,
    **dict.fromkeys(REGION_MAPS, 0.0),
}
CONTROLS = tuple(NEUTRALS)
# Maps of what is drawn; by all others pores and lines grow.
_DRAWN = ("strength", "scale", "pore_radius")
# Both middle codes of 8 bits, and all between them, are the middle: 0 of `signed`.
_DARKER, _LIGHTER = np.float32(127 / 255), np.float32(128 / 255)


@dataclass(frozen=True, eq=False)
class Controls:
    """Maps, as of `painted`, by name (of CONTROLS) and UDIM.

    Raises InputError naming the map that cannot be used, LimitError above MOST_TEXELS in all.
    """

    maps: Mapping[str, Mapping[int, Map]]

    def __post_init__(self) -> None:
        fixed: dict[str, dict[int, Map]] = {}
        for name, maps in sorted(self.maps.items()):
            if name not in CONTROLS:
                raise InputError(f"unknown control map {name}: one of {', '.join(CONTROLS)}")
            fixed[name] = {u: fixed_map(m, f"{name} of UDIM {u}") for u, m in sorted(maps.items())}
            every = [map for known in fixed.values() for map in known.values()]
            check_total(every, name, "control")
        object.__setattr__(self, "maps", fixed)

    @property
    def grow(self) -> bool:
        """Whether these maps move pores and lines."""
        return not set(self.maps) <= set(_DRAWN)

    def arrays(self) -> dict[str, Map]:
        """The maps as `name.udim`."""
        found = ((name, udim, map) for name, m in self.maps.items() for udim, map in m.items())
        return {f"{name}.{udim}": map for name, udim, map in found}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Map]) -> Controls:
        """The inverse of `arrays`."""
        maps: dict[str, dict[int, Map]] = {}
        for key, map in arrays.items():
            name, udim = key.rsplit(".", 1)
            maps.setdefault(name, {})[int(udim)] = map
        return cls(maps)

    def check_udims(self, udims: Sequence[int]) -> None:
        """Raise InputError for a map of a UDIM that is not among those of the mesh."""
        for name, maps in self.maps.items():
            for udim in maps:
                check_udim(udim, udims, f"a map of {name}")


def signed(grey: Shares) -> Shares:
    """From −1 (black) over 0 (mid grey, the codes 127 and 128 of 255) to 1 (white)."""
    low = (grey - _DARKER) / _DARKER
    high = (grey - _LIGHTER) / (np.float32(1.0) - _LIGHTER)
    found: Shares = np.minimum(low, 0.0) + np.maximum(high, 0.0)
    return found
