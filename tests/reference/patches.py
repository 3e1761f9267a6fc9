"""Factors of relief from patch to patch, of mean 1: a share everywhere, the rest log-normal by a
quadratic spline of a periodic table of noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from reference.inputs import Array


def factor(
    places: Array, cell: float, table: Array, rows: Array, amount: Array, deviation: float,
    most: float, least: float,
) -> Array:  # fmt: skip
    """(P,) at places (P, 3), mesh units.

    cell: of the table, mesh units.  table: (n + 2,)³, of which the first and the last nodes are
    others again.  rows: (3, 4), how it lies in space.  amount: (P,) patchiness;
    deviation of logarithms where that is 1, and the most.  least: the share."""
    own = np.asarray(table, np.float64)[1:-1, 1:-1, 1:-1]
    at = places / cell @ np.asarray(rows)[:, :3].T + np.asarray(rows)[:, 3]
    noise = map_coordinates(own, at.T, order=2, mode="grid-wrap", prefilter=False)
    spread = np.minimum(deviation * amount, most)
    found: Array = least + (1 - least) * np.exp(spread * noise - spread**2 / 2)
    return found
