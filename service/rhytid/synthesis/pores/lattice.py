"""Places in space as whole numbers, so that the device takes exact differences of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STEPS = 30
# A length that places are counted for has 2^_FINE steps: the order of places is the same at any
# scale of the mesh.
_FINE = 16
# What the origin is moved by where a mesh is far from that of its coordinates, in steps.
_BLOCK = 2.0 ** (_STEPS - 4)


@dataclass(frozen=True, eq=False)
class Lattice:
    """A cube of 2³⁰ steps per side.

    origin (3,): its lowest corner.  unit: a step.
    """

    origin: NDArray[np.float64]
    unit: float

    @classmethod
    def around(cls, *points: NDArray[np.floating]) -> Lattice:
        """The finest that holds all points of arrays (N, 3)."""
        low = np.min([p.min(axis=0) for p in points], axis=0).astype(np.float64)
        high = np.max([p.max(axis=0) for p in points], axis=0)
        extent = max(float((high - low).max()), 1e-30)
        return cls(low, 2.0 ** (int(np.floor(np.log2(extent))) + 1 - _STEPS))

    @classmethod
    def absolute(
        cls, length: float, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> Lattice:
        """One for `length`, that does not hang on what it holds, from `low` (3,) to `high` (3,).

        Its middle is the origin of coordinates, from which it reaches 2¹³ lengths. What
        reaches further moves it, and what is larger makes its steps coarser.
        """
        unit = length * 2.0**-_FINE
        half = 2.0 ** (_STEPS - 1) - 1.0
        if max(np.abs(low).max(), np.abs(high).max()) < half * unit:
            return cls(np.full(3, -(2.0 ** (_STEPS - 1)) * unit), unit)
        while float((high - low).max()) >= (2.0**_STEPS - 2.0 * _BLOCK) * unit:
            unit *= 2.0
        return cls(np.floor(low / (_BLOCK * unit)) * _BLOCK * unit, unit)

    def places(self, positions: NDArray[np.floating]) -> NDArray[np.int32]:
        """(..., 3) whole steps from the origin."""
        return np.rint((positions - self.origin) / self.unit).astype(np.int32)

    def positions(self, places: NDArray[np.int32]) -> NDArray[np.float64]:
        """(..., 3) where places are."""
        found: NDArray[np.float64] = self.origin + self.unit * places
        return found

    def steps(self, length: float) -> int:
        """A length in steps, at least one; rounded up."""
        return int(np.clip(np.ceil(length / self.unit), 1, 2**_STEPS))


def spatial_order(places: NDArray[np.int32]) -> NDArray[np.intp]:
    """(N,) an order in which neighbours (N, 3) are near each other: along Morton's curve.

    Which of two places comes first hangs on these alone.
    """
    code = np.zeros(len(places), np.uint64)
    for axis in range(3):
        code |= _spread(places[:, axis].astype(np.uint64) >> np.uint64(_STEPS - 21)) << np.uint64(
            axis
        )
    order: NDArray[Any] = np.argsort(code, kind="stable")
    ordered = code[order]
    if (ordered[1:] == ordered[:-1]).any():
        order = np.lexsort((*places.T, code))
    return order


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The lowest 21 bits, three apart."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        value = (value | (value << np.uint64(shift))) & np.uint64(mask)
    return value
