"""Units of length by their names, and how long skin is in them."""

from __future__ import annotations

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


def millimetres(unit: str) -> float | None:
    """Millimetres in a unit of that name; None for a name that is not known."""
    # The micro sign and the Greek letter look alike; lower case makes the letter of both.
    return _BY_NAME.get(unit.casefold())


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
