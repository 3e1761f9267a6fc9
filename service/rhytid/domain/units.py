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


def millimetres(unit: str) -> float | None:
    """Millimetres in a unit of that name; None for a name that is not known."""
    # The micro sign and the Greek letter look alike; lower case makes the letter of both.
    return _BY_NAME.get(unit.casefold())


_BY_NAME = {name.casefold(): length for name, length in MILLIMETRES.items()}
