"""Lengths on skin, and units of length.

Lengths are the distance of pores, and what is chosen in proportion to it. Units have a name, as cm,
or a number and a name, as 5.5cm.
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

    spacing: mean distance from a pore to the nearest.  depth: of a wrinkle of strength 1.
    """

    spacing: float
    depth: float


# Of the whole face, by eye. Usual lengths stand here and nowhere else.
SKIN = Skin(spacing=0.5, depth=0.075)
# In units of the spacing of the pores, unless they are set.
DEPTH_OF_SPACING = SKIN.depth / SKIN.spacing
SIGMA_OF_SPACING = 0.25
# Waves in a spacing: most wrinkles get a bend.
WAVES_OF_SPACING = 0.4


@dataclass(frozen=True)
class Lengths:
    """The lengths that a wrinkle graph is drawn with unless settings say otherwise, in mesh units.

    spacing: of pores where density is 1.  depth: of a wrinkle of strength 1.  sigma: standard
    deviation of the Gaussian of `convolved`.  wave_frequency: waves in a mesh unit.  grain_size,
    undulation_size: largest wavelengths of the relief between the lines; None for the usual ones,
    `GRAIN` and `UNDULATION`.
    """

    spacing: float
    depth: float
    sigma: float
    wave_frequency: float
    grain_size: float | None = None
    undulation_size: float | None = None

    @classmethod
    def of(cls, spacing: float, age: float = USUAL_AGE) -> Lengths:
        """The usual lengths for a spacing, in proportion to it; depth grows with age."""
        return cls(
            spacing,
            DEPTH_OF_SPACING * spacing * depth_factor(age),
            SIGMA_OF_SPACING * spacing,
            WAVES_OF_SPACING / spacing,
        )


def usual_spacing(unit: str) -> float:
    """The usual distance of pores in a mesh of that unit, mesh units.

    Raises SettingsError for a unit that has no known length.
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
    """The usual largest wavelength of a relief between the lines: in millimetres, and in units of
    the spacing of pores, for meshes whose unit has no known length."""

    millimetres: float
    of_spacing: float

    def resolved(self, given: float | None, unit: str, lengths: Lengths) -> float:
        """The wavelength, mesh units: as given, else by the unit, else by the spacing of pores."""
        if given is not None:
            return given
        length = millimetres(unit)
        return self.of_spacing * lengths.spacing if length is None else self.millimetres / length


GRAIN = LargestWave(millimetres=0.2, of_spacing=0.36)
UNDULATION = LargestWave(millimetres=6.0, of_spacing=10.8)


# Settings are read far more often than units change.
@lru_cache(256)
def millimetres(unit: str) -> float | None:
    """Millimetres in a unit, a name or a number and a name as `5.5cm`; None where it is unknown."""
    count, name = _parts(unit)
    # The micro sign and the Greek letter look alike; lower case makes the letter of both.
    length = _BY_NAME.get(name.casefold())
    if length is None or not SHORTEST <= count * length <= LONGEST:
        return None
    return count * length


def unit_after_number(unit: str) -> str:
    """A unit as it is written after a number: `cm` as in 3 cm, `x 5.5cm` as in 3 x 5.5cm."""
    return f"x {unit}" if unit[:1].isdecimal() or unit.startswith(".") else unit


def unit_pair(factor: float, unit: str, tolerance: float) -> tuple[str, str] | None:
    """Two units of meshes such that numbers in the second are `factor` times those in the first.

    unit: the first of them, where that is possible.  tolerance: of the factor, relative. None where
    no two units fit.
    """
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
