"""Maps painted in UV: controls, which guide synthesis, and stiffness.

A map (h, w) of any size, square or not, holds uint8 or uint16 codes of which the largest is 1, and
stays so, in 8 bits where they are enough; or floats from 0 to 1, kept as float32. Row 0 is the top:
texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h. Between centres a map
is bilinear, beyond the outermost it goes on as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.skin import REGIONS, WHOLE_FACE
from rhytid.domain.tiles import texel_centres
from rhytid.domain.validation import fixed_array
from rhytid.errors import InputError, LimitError

Map = NDArray[Any]
Shares = NDArray[np.float32]
# Of all maps of a kind together: 8192² twice, or 4096² eight times.
MOST_TEXELS = 2**27
# 65535/255: a code of 16 bits that is such a multiple is the same share as a code of 8 bits.
_CODES_A_BYTE = 257
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
    "events": 0.5,
    **dict.fromkeys(REGION_MAPS, 0.0),
}
CONTROLS = tuple(NEUTRALS)
# Maps of what is drawn; by all others pores and lines grow.
_DRAWN = ("strength", "scale", "pore_radius", "events")
# Both middle codes of 8 bits, and all between them, are the middle: 0 of `signed`.
_DARKER, _LIGHTER = np.float32(127 / 255), np.float32(128 / 255)
# Plain skin; also the value where there is no map.
NEUTRAL = 1.0


@dataclass(frozen=True, eq=False)
class Controls:
    """Control maps by name, one of CONTROLS, and UDIM: they guide synthesis.

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
        """Whether these maps change where pores and lines grow, not their look alone."""
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


def painted_regions(controls: Controls | None) -> dict[str, Mapping[int, Map]]:
    """Masks of regions that are painted, by region and UDIM."""
    maps = {} if controls is None else controls.maps
    prefixed = ((name, masks) for name, masks in maps.items() if name in REGION_MAPS)
    return {name.removeprefix(REGION_PREFIX): masks for name, masks in prefixed}


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Stiffness maps by UDIM: clamped log stretch is multiplied by them, so 1 is as the paper has
    it, and 0 is rigid. A UDIM without a map is 1 throughout.

    Raises InputError naming the map that cannot be used, LimitError above MOST_TEXELS in all.
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
        """(P,) stiffness at points (P, 2) in UV local to the UDIM."""
        map = self.maps.get(udim)
        if map is None:
            return np.full(len(local), NEUTRAL, np.float32)
        return bilinear(map, local)

    def texels(
        self, udim: int, side: int, row: int, column: int, count: int
    ) -> NDArray[np.float32] | None:
        """(count, count) stiffness at the texel centres of a level of `side` texels, from (row,
        column) on; None where all of it is 1."""
        map = self.maps.get(udim)
        if map is None:
            return None
        found = texels_of(map, side, row, column, count)
        return None if (found == NEUTRAL).all() else found


def signed(grey: Shares) -> Shares:
    """Greys as numbers from −1 (black) over 0 (mid grey, the codes 127 and 128 of 255) to 1."""
    low = (grey - _DARKER) / _DARKER
    high = (grey - _LIGHTER) / (np.float32(1.0) - _LIGHTER)
    found: Shares = np.minimum(low, 0.0) + np.maximum(high, 0.0)
    return found


def shares(texels: Map) -> Shares:
    """Texels as float32 from 0 to 1: codes over the largest code, floats as they are."""
    found: Shares = texels.astype(np.float32, copy=False)
    return found if texels.dtype.kind == "f" else found / np.float32(np.iinfo(texels.dtype).max)


def bilinear(
    map: Map, local: NDArray[np.floating], meaning: Callable[[Map], Shares] = shares
) -> Shares:
    """(P,) bilinear values at points (P, 2) in UV local to the UDIM of a map.

    meaning: applied to the texels before they are interpolated.
    """
    left, right, x = neighbour_texels(local[:, 0], map.shape[1])
    top, bottom, y = neighbour_texels(1.0 - local[:, 1].astype(np.float64), map.shape[0])
    rows = [mix(meaning(map[i, left]), meaning(map[i, right]), x) for i in (top, bottom)]
    return mix(rows[0], rows[1], y)


def texels_of(map: Map, side: int, row: int, column: int, count: int) -> Shares:
    """(count, count) bilinear values of a map at the texel centres of one of `side` texels, from
    (row, column) on."""
    left, right, x = neighbour_texels(texel_centres(column, count, side), map.shape[1])
    top, bottom, y = neighbour_texels(texel_centres(row, count, side), map.shape[0])
    rows = [mix(shares(map[i][:, left]), shares(map[i][:, right]), x) for i in (top, bottom)]
    return mix(rows[0], rows[1], y[:, None])


def neighbour_texels(
    share: NDArray[np.floating], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Shares]:
    """The texels on both sides of points along one side of a map.

    share: (P,) places of the points, from 0 to 1 over `size` texels. Returns (P,) first texels,
    (P,) second texels, and (P,) how far from the first to the second the points are.
    """
    place = np.clip(share.astype(np.float64) * size - 0.5, 0.0, size - 1.0)
    first = np.floor(place).astype(np.int64)
    return first, np.minimum(first + 1, size - 1), (place - first).astype(np.float32)


def mix(one: Shares, other: Shares, share: Shares) -> Shares:
    """Linear interpolation from `one` to `other`, exact where both are equal."""
    mixed: Shares = one + share * (other - one)
    return mixed


def fixed_map(map: Map, what: str) -> Map:
    """A read-only copy of a map; raises InputError naming `what` where it is no map."""
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
    """Raise LimitError where maps exceed MOST_TEXELS together.  what: the last of them."""
    total = sum(map.size for map in maps)
    if total > MOST_TEXELS:
        rule = f"at most {MOST_TEXELS}"
        raise LimitError(f"{what}: {kind} maps up to it have {total} texels in all: {rule}")


def check_udim(udim: int, udims: Sequence[int], what: str) -> None:
    """Raise InputError where the UDIM of `what` is not among those of the mesh."""
    if udim not in udims:
        have = ", ".join(str(known) for known in udims)
        raise InputError(f"{what} is of UDIM {udim}, which has no mesh; the mesh has {have}")
