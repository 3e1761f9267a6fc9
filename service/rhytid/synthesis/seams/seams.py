"""Wrinkles across a UV seam, from each of their pores up to the border of its chart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.charts import trace
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface

Triangles = NDArray[np.int32]
# The two halves of a wrinkle meet within this share of its length.
GAP = 0.25


@dataclass(frozen=True, eq=False)
class Halves:
    """The part of each wrinkle on its first pore's side of a seam.

    step (N, 2): UV vector to where the second pore would be if the chart went on.
    share (N,): how much of it lies on the chart, 1 where it meets no border.
    exit (N, 3): the place on the surface where it leaves the chart.  exit_uv (N, 2): in UV.
    last (N,): the triangle there.  middle (N,): that of the midpoint, BORDER where the chart ends
    before.
    """

    step: FloatArray
    share: FloatArray
    exit: FloatArray
    exit_uv: FloatArray
    last: IntArray
    middle: IntArray


def halves(
    surface: Surface, across: Triangles, pores: Points, nodes: NDArray[np.integer]
) -> Halves:
    """Head from pores nodes[:, 0] for nodes[:, 1] in the tangent plane, up to the border."""
    one, two = nodes.T
    triangle, origin = pores.triangle[one], pores.uv[one].astype(np.float64)
    ahead = pores.position[two] - pores.position[one]
    step = np.einsum("ncx,nx->nc", np.linalg.pinv(surface.jacobian[triangle]), ahead)
    line = trace(surface, across, triangle, origin, step)
    end = origin + line.share[:, None] * step
    return Halves(step, line.share, surface.place(line.end, end), end, line.end, line.middle)


def meets_at_seam(
    surface: Surface,
    across: Triangles,
    pores: Points,
    nodes: NDArray[np.integer],
    length: NDArray[np.floating],
) -> BoolArray:
    """(N,) true where both halves leave their charts at the same place of the surface."""
    there = halves(surface, across, pores, nodes)
    back = halves(surface, across, pores, nodes[:, ::-1])
    gap = np.linalg.norm(there.exit - back.exit, axis=-1)
    meets: BoolArray = (there.share < 1.0) & (back.share < 1.0) & (gap <= GAP * length)
    return meets & _long_enough(pores, nodes[:, 0], there) & _long_enough(pores, nodes[:, 1], back)


def _long_enough(pores: Points, owner: NDArray[np.integer], half: Halves) -> BoolArray:
    """(N,) true where float32 tells the border from the pore."""
    origin = pores.uv[owner]
    end = origin + half.share[:, None] * half.step
    distinct: BoolArray = (end.astype(np.float32) != origin).any(axis=1)
    return distinct
