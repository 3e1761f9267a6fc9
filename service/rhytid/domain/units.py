"""Units of length by their names, or by a number and a name: 5.5cm."""

from __future__ import annotations

import re
from functools import lru_cache

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
OF_MESHES = ("mm", "cm", "m", "in", "ft")
# Millimetres in a unit of a number and a name.
SHORTEST, LONGEST = 1e-9, 1e9
_COUNTED = re.compile(r" *([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?) *([^\W\d_]+) *")


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


def beside_number(unit: str) -> str:
    """A unit as it is read behind a number: `3 cm`, but `3 x 5.5cm`."""
    return f"x {unit}" if unit[:1].isdecimal() or unit.startswith(".") else unit


def _parts(unit: str) -> tuple[float, str]:
    match = _COUNTED.fullmatch(unit)
    return (1.0, unit) if match is None else (float(match[1]), match[2])


_BY_NAME = {name.casefold(): length for name, length in MILLIMETRES.items()}


def unit_pair(factor: float, unit: str, tolerance: float) -> tuple[str, str] | None:
    """Two units of meshes: numbers in the second are `factor` times those in the first, within a
    share of it. The first is `unit` where that can be. None where there are no such two."""
    for first in sorted(OF_MESHES, key=lambda name: name != unit):
        for second in OF_MESHES:
            near = abs(factor * MILLIMETRES[second] / MILLIMETRES[first] - 1.0) <= tolerance
            if near and first != second:
                return first, second
    return None
