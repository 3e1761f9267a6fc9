"""What even skin is like, in numbers that nothing painted moves.

Strengths, weights and sizes are meant against these, not against the means of the skin that grows:
a mean over the surface would carry what is painted in one place to all others. Measured on a real
face and on flat sheets.
"""

from __future__ import annotations

from dataclasses import dataclass

# Centres per r² once all darts are thrown, r the radius of the discs. (Thrown for ever, discs jam
# at 0.547 · 4/π = 0.696; the last of them fit into rooms too small to see.)
PACKING = 0.605
# Mean distance of a pore to the nearest, in r.
SPACING = 1.0935
# Mean length of the candidate edges, in r.
LENGTH = 1.408
# Where each pore looks for so many neighbours, or more: candidate edges per pore; and the strength
# at which the faintest is drawn where the number of wrinkles is not given, 2.1 per pore.
_NEIGHBOURS = {
    4: (2.21, 0.057),
    5: (2.6, 0.235),
    6: (2.8, 0.29),
    7: (2.85, 0.303),
    8: (2.86, 0.303),
}
# The strength at which the faintest edge of the coarse net becomes a primary line, 1.9 per coarse
# pore, and the mean of all that do, sharpened.
FAINTEST_PRIMARY, PRIMARY_STRENGTH = 0.675, 1.468


@dataclass(frozen=True)
class Usual:
    """strength: mean of the edges that are drawn.  meeting: mean sum of the weights of the wrinkles
    that meet at a pore."""

    strength: float
    meeting: float


WITH_PRIMARY, WITHOUT_PRIMARY = Usual(1.446, 1.114), Usual(0.872, 1.18)


def edges_per_pore(neighbours: int) -> float:
    """Candidate edges per pore."""
    return _NEIGHBOURS[min(neighbours, 8)][0]


def faintest(neighbours: int) -> float:
    """The strength at which an edge is drawn, where the number of wrinkles is not given."""
    return _NEIGHBOURS[min(neighbours, 8)][1]
