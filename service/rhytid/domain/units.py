"""Length units that are known by name. Others may be set; then nothing is said of sizes."""

from __future__ import annotations

# Millimetres in a unit.
MILLIMETRES: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}


def unit_pair(factor: float, unit: str, tolerance: float) -> tuple[str, str] | None:
    """Two units, of which numbers in the second are `factor` times those in the first, within a
    share of it; the first is `unit` where that can be. None where there are no such two."""
    for first in sorted(MILLIMETRES, key=lambda name: name != unit):
        for second, length in MILLIMETRES.items():
            near = abs(factor * length / MILLIMETRES[first] - 1.0) <= tolerance
            if near and first != second:
                return first, second
    return None
