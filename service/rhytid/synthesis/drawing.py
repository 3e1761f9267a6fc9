"""Wrinkles as they are stored: whole ones, and two halves for each that crosses a UV seam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.charts import BORDER
from rhytid.synthesis.edges import Edges
from rhytid.synthesis.net import Ground, Net
from rhytid.synthesis.seams import halves
from rhytid.synthesis.shapes import WIDE, half_widths_uv
from rhytid.synthesis.surface import FloatArray, Points

Indices = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Lines:
    """W stored lines and the S nodes that some of them need beyond a border.

    edge (W,): the candidate that each draws.  nodes (W, 2): pores, then the nodes beyond from
    number N on.  step (W, 2): from the first node to the second in UV.
    triangle (W,): the triangle to sample.
    owner (S,): the pore on whose side of the seam each node beyond belongs.  beyond (S, 2): its uv.
    """

    edge: Indices
    nodes: Indices
    step: NDArray[np.float32]
    triangle: Indices
    owner: Indices
    beyond: NDArray[np.float32]


def lines_of(edges: Edges) -> int:
    """How many lines the edges take in the graph."""
    return len(edges) + int(np.count_nonzero(edges.middle == BORDER))


def stored(lines: NDArray[np.uint8]) -> tuple[Indices, NDArray[np.uint8]]:
    """As many lines (E,) of each edge, in the order of their numbers, which is that of space: edge
    (W,) and side 0 or 1 (W,).

    Where there is one of two halves the wrinkle ends at the seam.
    """
    drawn = np.flatnonzero(lines).astype(np.int32)
    edge = np.repeat(drawn, lines[drawn])
    side = np.zeros(len(edge), np.uint8)
    side[1:] = edge[1:] == edge[:-1]
    return edge, side


def draw(ground: Ground, net: Net, edge: Indices, side: NDArray[np.uint8], spacing: float) -> Lines:
    """Put edge (W,) of a net, from its node `side` (W,) on, into the map."""
    nodes, pores = net.edges.nodes[edge], net.pores
    turned = np.flatnonzero(side)
    nodes[turned] = nodes[turned, ::-1]
    step = pores.uv[nodes[:, 1]] - pores.uv[nodes[:, 0]]
    triangle = net.edges.middle[edge]
    split = np.flatnonzero(triangle == BORDER)
    owner = nodes[split, 0]
    triangle[split] = pores.triangle[owner]
    step[split] = _over_the_border(ground, pores, nodes[split], spacing)
    beyond = pores.uv[owner] + step[split]
    nodes[split, 1] = len(pores) + np.arange(len(split))
    return Lines(edge, nodes, step, triangle, owner, beyond)


def _over_the_border(ground: Ground, pores: Points, nodes: Indices, spacing: float) -> FloatArray:
    """(S, 2) UV steps that hide the round end of the widest line, but go no further."""
    half = halves(ground.surface, ground.across, pores, nodes)
    widest = np.full(len(nodes), WIDE * spacing)
    end = half_widths_uv(ground.surface, pores.triangle[nodes[:, 0]], half.step, widest)
    share = half.share + end / np.linalg.norm(half.step, axis=-1)
    steps: FloatArray = half.step * np.minimum(share, 1.0)[:, None]
    return steps
