"""Lengths on skin: how far pores stand apart, and what is chosen in proportion to that."""

from __future__ import annotations

from dataclasses import dataclass

from rhytid.domain.ageing import USUAL_AGE, deepest
from rhytid.domain.units import MILLIMETRES, millimetres
from rhytid.errors import SettingsError


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
            DEPTH_OF_SPACING * spacing * deepest(age),
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
