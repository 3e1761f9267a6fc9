"""Candidate wrinkles: straight lines in the map from each pore to its nearest on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.synthesis.charts import BORDER, trace
from rhytid.synthesis.paths import rank_at
from rhytid.synthesis.pores import nearest
from rhytid.synthesis.seams import meets_at_seam
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface, unit

# Longest wrinkle, in disc radii: between maximal discs no polygon needs a longer side.
REACH = 2.2
# Of two wrinkles that leave a pore at a smaller angle the longer is no candidate: it would run
# beside the shorter as a double line.
LEAST_ANGLE = np.radians(35.0)
# Surface length of a straight line in the map over the distance of its pores.
DETOUR = 1.4
_ROWS = 1 << 14


@dataclass(frozen=True, eq=False)
class Edges:
    """Candidate wrinkles, shortest first.

    nodes (E, 2): the pores joined.  length (E,): their distance.
    middle (E,): the triangle of the midpoint, BORDER for a wrinkle across a UV seam.
    """

    nodes: IntArray
    length: FloatArray
    middle: IntArray

    def __len__(self) -> int:
        return len(self.nodes)

    def take(self, index: BoolArray | IntArray) -> Edges:
        """The edges of an index or a mask, in its order."""
        return Edges(self.nodes[index], self.length[index], self.middle[index])


def candidates(
    surface: Surface, across: IntArray, pores: Points, radius: float, count: int
) -> Edges:
    """Edges from each pore to its `count` nearest, those that can be drawn on the map.

    across: (F, 3) neighbours of the triangles.  radius: of the discs around the pores.
    """
    nodes = _pairs(nearest(pores, REACH * radius, count))
    length = np.linalg.norm(pores.position[nodes[:, 0]] - pores.position[nodes[:, 1]], axis=-1)
    order = np.argsort(length, kind="stable")
    order = order[~_beside_shorter(pores, nodes[order])]
    nodes, length = nodes[order], length[order]
    middle = _middles(surface, across, pores, nodes, length)
    drawable = middle != BORDER
    rest = np.flatnonzero(~drawable)
    drawable[rest] = meets_at_seam(surface, across, pores, nodes[rest], length[rest])
    return Edges(nodes, length, middle).take(drawable)


def _pairs(near: IntArray) -> IntArray:
    """(E, 2) each pair of neighbours once."""
    count = len(near)
    own, slot = np.nonzero(near < count)
    other = near[own, slot]
    code = np.unique(np.minimum(own, other) * count + np.maximum(own, other))
    return np.stack(np.divmod(code, count), axis=-1)


def _beside_shorter(pores: Points, nodes: IntArray) -> BoolArray:
    """(E,) true for an edge, of edges shortest first, that leaves a pore beside a shorter one."""
    source, target = nodes.ravel(), nodes[:, ::-1].ravel()
    slot = rank_at(source, len(pores))
    sight = np.zeros((len(pores), int(slot.max(initial=0)) + 1, 3))
    sight[source, slot] = unit(pores.position[target] - pores.position[source])
    hidden = np.zeros(sight.shape[:2], bool)
    shorter = np.tri(sight.shape[1], k=-1, dtype=bool)
    for first in range(0, len(pores), _ROWS):
        rows = slice(first, first + _ROWS)
        cosine = sight[rows] @ sight[rows].transpose(0, 2, 1)
        hidden[rows] = ((cosine > np.cos(LEAST_ANGLE)) & shorter).any(axis=2)
    beside: BoolArray = np.any(hidden[source, slot].reshape(-1, 2), axis=1)
    return beside


def _middles(
    surface: Surface, across: IntArray, pores: Points, nodes: IntArray, length: FloatArray
) -> IntArray:
    """(E,) the middle triangle of each straight line in the map, BORDER where there is none."""
    one, two = nodes.T
    step = pores.uv[two] - pores.uv[one]
    line = trace(surface, across, pores.triangle[one], pores.uv[one], step)
    whole = (line.share == 1.0) & (line.end == pores.triangle[two]) & step.any(axis=1)
    whole &= (line.length <= DETOUR * length) & (line.middle != BORDER)
    whole &= surface.carries[line.middle]
    return np.where(whole, line.middle, BORDER)
