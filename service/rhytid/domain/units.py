"""Length units that are known by name. Others may be set; then nothing is said of sizes."""

from __future__ import annotations

# Millimetres in a unit.
MILLIMETRES: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}


def unit_near(millimetres: float, tolerance: float) -> str | None:
    """The unit of that many millimetres within a share of it, or None."""
    for name, length in MILLIMETRES.items():
        if abs(millimetres / length - 1.0) <= tolerance:
            return name
    return None
