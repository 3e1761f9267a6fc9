"""Lengths on skin, and units of length.

Lengths: how far pores stand apart, and what is chosen in proportion to that. Units: by their names,
or by a number and a name, as in 5.5cm.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from rhytid.domain.skin import USUAL_AGE, depth_factor
from rhytid.errors import SettingsError

# Millimetres in one. Names are compared without regard to case.
MILLIMETRES = {
    "um": 0.001,
    "µm": 0.001,
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1000.0,
    "in": 25.4,
    "ft": 304.8,
}
USUAL_UNIT = "cm"
# Those that meshes come in: what a wrong one is compared with.
MESH_UNITS = ("mm", "cm", "m", "in", "ft")
# Millimetres in a unit of a number and a name.
SHORTEST, LONGEST = 1e-9, 1e9
_COUNTED = re.compile(r" *([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?) *([^\W\d_]+) *")


@dataclass(frozen=True)
class Skin:
    """Lengths of a kind of skin, in millimetres.

    spacing: mean distance from a pore to the nearest.  depth: of a wrinkle of strength 1 there.
    """

    spacing: float
    depth: float


# Of the whole face, by eye: this is the one place where usual lengths stand.
SKIN = Skin(spacing=0.5, depth=0.075)
# In units of the spacing of the pores, unless they are set.
DEPTH_OF_SPACING = SKIN.depth / SKIN.spacing
SIGMA_OF_SPACING = 0.25
# Waves in a spacing: most wrinkles get a bend.
WAVES_OF_SPACING = 0.4


@dataclass(frozen=True)
class Lengths:
    """What a wrinkle graph is drawn with unless settings say otherwise, in mesh units.

    spacing: of pores where density is 1.  depth: of strength 1.  sigma: of the Gaussian of
    `convolved`.  wave_frequency: waves in a mesh unit.  grain_size, undulation_size: the largest
    waves of the relief between the lines; None: as `LargestWave` has it.
    """

    spacing: float
    depth: float
    sigma: float
    wave_frequency: float
    grain_size: float | None = None
    undulation_size: float | None = None

    @classmethod
    def of(cls, spacing: float, age: float = USUAL_AGE) -> Lengths:
        """All in proportion to the spacing; the deepest lines of an age are deeper."""
        return cls(
            spacing,
            DEPTH_OF_SPACING * spacing * depth_factor(age),
            SIGMA_OF_SPACING * spacing,
            WAVES_OF_SPACING / spacing,
        )


def usual_spacing(unit: str) -> float:
    """Distance of pores in a mesh of that unit, where nothing says otherwise.

    Raises SettingsError for a unit that is not known.
    """
    length = millimetres(unit)
    if length is None:
        raise SettingsError(
            f"unit is {unit!r}, which has no known length, so that graph.spacing has no default: "
            "set graph.spacing in mesh units, or graph.wrinkles; known are "
            + ", ".join(MILLIMETRES)
            + " or so many of one, as '5.5cm'"
        )
    return SKIN.spacing / length


@dataclass(frozen=True)
class LargestWave:
    """Of a relief between the lines: in millimetres, and in units of the spacing of the pores."""

    millimetres: float
    of_spacing: float

    def resolved(self, given: float | None, unit: str, lengths: Lengths) -> float:
        """Mesh units: what is given, else by the unit where that is a length, else by spacing."""
        if given is not None:
            return given
        length = millimetres(unit)
        return self.of_spacing * lengths.spacing if length is None else self.millimetres / length


GRAIN = LargestWave(millimetres=0.2, of_spacing=0.36)
UNDULATION = LargestWave(millimetres=6.0, of_spacing=10.8)


# Settings are read far more often than units change.
@lru_cache(256)
def millimetres(unit: str) -> float | None:
    """Millimetres in a unit: of that name, or so many of those of a name, as in `5.5cm`; None for a
    unit that is not known."""
    count, name = _parts(unit)
    # The micro sign and the Greek letter look alike; lower case makes the letter of both.
    length = _BY_NAME.get(name.casefold())
    if length is None or not SHORTEST <= count * length <= LONGEST:
        return None
    return count * length


def unit_after_number(unit: str) -> str:
    """A unit as it is read behind a number: `3 cm`, but `3 x 5.5cm`."""
    return f"x {unit}" if unit[:1].isdecimal() or unit.startswith(".") else unit


def unit_pair(factor: float, unit: str, tolerance: float) -> tuple[str, str] | None:
    """Two units of meshes: numbers in the second are `factor` times those in the first, within a
    share of it. The first is `unit` where that can be. None where there are no such two."""
    for first in sorted(MESH_UNITS, key=lambda name: name != unit):
        for second in MESH_UNITS:
            near = abs(factor * MILLIMETRES[second] / MILLIMETRES[first] - 1.0) <= tolerance
            if near and first != second:
                return first, second
    return None


def _parts(unit: str) -> tuple[float, str]:
    match = _COUNTED.fullmatch(unit)
    return (1.0, unit) if match is None else (float(match[1]), match[2])


_BY_NAME = {name.casefold(): length for name, length in MILLIMETRES.items()}
