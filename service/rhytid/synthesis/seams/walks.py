"""Steps on the surface: straight in the map, and straight on over its seams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.charts import side_at, trace
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Surface

# Seams that one step may cross.
_SEAMS = 3


def walk(
    surface: Surface,
    across: NDArray[np.int32],
    borders: Borders,
    triangle: NDArray[np.integer],
    uv: FloatArray,
    step: FloatArray,
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Go from uv (N, 2) in triangles (N,) by UV steps (N, 2), straight on over seams: the triangles
    (N,) and uv (N, 2) at the end, and (N,) whether the whole step was gone. It is not where the
    surface ends, or more than a few seams are in the way.

    across: (F, 3) neighbours of the triangles.
    """
    at: IntArray = triangle.astype(np.int64)
    arrived: BoolArray = np.zeros(len(uv), np.bool_)
    uv, going, left = uv.copy(), np.arange(len(uv)), step.copy()
    for _ in range(_SEAMS + 1):
        line = trace(surface, across, at[going], uv[going], left[going])
        at[going] = line.end
        uv[going] += line.share[:, None] * left[going]
        left[going] *= (1.0 - line.share)[:, None]
        arrived[going[line.share >= 1.0]] = True
        going = _over(surface, borders, at, uv, left, going[line.share < 1.0])
        if not len(going):
            break
    return at, uv, arrived


def _over(
    surface: Surface,
    borders: Borders,
    triangle: IntArray,
    uv: FloatArray,
    left: FloatArray,
    rows: IntArray,
) -> IntArray:
    """Take what stands at a seam to its other side, in place; those of `rows` that were taken."""
    row = borders.row[triangle[rows], side_at(surface.uv[triangle[rows]], uv[rows])]
    mate = np.where(row == NONE, NONE, borders.mate[row])
    rows, mate = rows[mate != NONE], mate[mate != NONE]
    uv[rows] = borders.from_mate(mate, uv[rows])
    left[rows] = np.einsum("nij,nj->ni", borders.turn_from_mate(mate), left[rows])
    triangle[rows] = borders.triangle[mate]
    return rows
