"""Wrinkles as they are stored: each on the chart of one of its pores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import ORIGINAL
from rhytid.synthesis.edges.candidate_graph import CandidateGraph, Ground
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.charts import BORDER, SIDES, cross
from rhytid.synthesis.seams.seams import Halves, halves
from rhytid.synthesis.shapes import WIDE, half_widths_uv
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points

Indices = NDArray[np.int32]
# A wrinkle whose far pore, laid flat, is so much nearer or farther than on the surface is cut at
# the seam: the charts meet in a corner there.
_BEND = 2.0


@dataclass(frozen=True, eq=False)
class Lines:
    """W stored lines and the S nodes that some of them need beyond a border.

    edge (W,): the candidate that each draws.  pores (W, 2): that it joins.  nodes (W, 2): pores,
    then the nodes beyond from number N on.  step (W, 2): from the first node to the second in UV.
    triangle (W,): the triangle to sample.  copy_of (W,): ORIGINAL, or of the second half of a
    wrinkle that is cut at a seam the line that is the first.
    owner (S,): the pore on whose chart each node beyond belongs.  stands_for (S,): the pore whose
    place it takes.  beyond (S, 2): its uv.  turn (S, 2, 2): steps there in UV, from those in the
    chart of that pore.
    """

    edge: Indices
    pores: Indices
    nodes: Indices
    step: NDArray[np.float32]
    triangle: Indices
    copy_of: Indices
    owner: Indices
    stands_for: Indices
    beyond: NDArray[np.float32]
    turn: FloatArray


def draw(
    ground: Ground, net: CandidateGraph, borders: Borders, edge: Indices, spacing: float
) -> Lines:
    """Put edges (W,) of a net into the map: one across a seam on the chart with its middle."""
    joined, pores = net.edges.nodes[edge], net.pores
    triangle = net.edges.middle[edge]
    split = np.flatnonzero(triangle == BORDER)
    half = _turned_to_middle(ground, pores, joined, split)
    step = pores.uv[joined[:, 1]] - pores.uv[joined[:, 0]]
    triangle[split] = np.where(half.middle == BORDER, half.last, half.middle)
    owner, other = joined[split].T
    flat, whole, turn = _laid_flat(ground, pores, borders, joined[split], half)
    step[split] = flat
    cut = split[~whole]
    step[cut] = _over_the_border(ground, pores, joined[cut], spacing)
    nodes, count = joined.copy(), len(pores)
    nodes[split, 1] = count + np.arange(len(split))
    # Of a cut one the other half, from the seam on to the other pore.
    back = -_over_the_border(ground, pores, joined[cut, ::-1], spacing)
    ends = np.stack([count + len(split) + np.arange(len(cut)), joined[cut, 1]], axis=1)
    return Lines(
        np.concatenate([edge, edge[cut]]),
        np.concatenate([joined, joined[cut]]),
        np.concatenate([nodes, ends]).astype(np.int32),
        np.concatenate([step, back.astype(np.float32)]),
        np.concatenate([triangle, pores.triangle[joined[cut, 1]]]).astype(np.int32),
        np.concatenate([np.full(len(edge), ORIGINAL), cut]).astype(np.int32),
        np.concatenate([owner, joined[cut, 1]]),
        np.concatenate([other, joined[cut, 0]]),
        np.concatenate([pores.uv[owner] + step[split], pores.uv[joined[cut, 1]] - back]).astype(
            np.float32
        ),
        np.concatenate([turn, turn[~whole]]),
    )


def _turned_to_middle(ground: Ground, pores: Points, nodes: Indices, split: IntArray) -> Halves:
    """The longer halves of wrinkles across a seam; nodes (W, 2) of these are turned in place to
    start with them."""
    there = halves(ground.surface, ground.across, pores, nodes[split])
    back = halves(ground.surface, ground.across, pores, nodes[split, ::-1])
    turned = back.share > there.share
    nodes[split[turned]] = nodes[split[turned], ::-1]
    return Halves(
        *(
            np.where(turned.reshape(-1, *(one.ndim - 1) * (1,)), two, one)
            for one, two in zip(vars(there).values(), vars(back).values(), strict=True)
        )
    )


def _laid_flat(
    ground: Ground, pores: Points, borders: Borders, nodes: Indices, half: Halves
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """(S, 2) UV steps to where the second pore is with the two triangles at the seam laid flat,
    (S,) where that can be said, and (S, 2, 2) how steps at that pore turn with them."""
    surface, (owner, other) = ground.surface, nodes.T
    row = borders.row[half.last, _side_at(surface.uv[half.last], half.exit_uv)]
    mate = np.where(row == NONE, NONE, borders.mate[row])
    landing = borders.chart[borders.triangle[mate]]
    known = (mate != NONE) & (landing == borders.chart[pores.triangle[other]])
    origin = pores.uv[owner].astype(np.float64)
    known_row = np.where(known, row, 0)
    step = borders.from_mate(known_row, pores.uv[other].astype(np.float64)) - origin
    flat, length = (
        np.linalg.norm(surface.along(pores.triangle[owner], vector), axis=-1)
        for vector in (step, half.step)
    )
    known &= (flat < _BEND * length) & (length < _BEND * flat)
    turn = borders.turn_from_mate(known_row)
    return np.where(known[:, None], step, half.step), known, turn


def _side_at(corners: FloatArray, uv: FloatArray) -> IntArray:
    """(S,) the side of triangles (S, 3, 2) that goes through points (S, 2) on their rims."""
    start, stop = corners[:, SIDES[:, 0]], corners[:, SIDES[:, 1]]
    along = stop - start
    off = np.abs(cross(along, uv[:, None] - start)) / np.linalg.norm(along, axis=-1)
    side: IntArray = np.argmin(off, axis=1)
    return side


def _over_the_border(ground: Ground, pores: Points, nodes: Indices, spacing: float) -> FloatArray:
    """(S, 2) UV steps that hide the round end of the widest line, but go no further."""
    half = halves(ground.surface, ground.across, pores, nodes)
    widest = np.full(len(nodes), WIDE * spacing)
    end = half_widths_uv(ground.surface, pores.triangle[nodes[:, 0]], half.step, widest)
    share = half.share + end / np.linalg.norm(half.step, axis=-1)
    steps: FloatArray = half.step * np.minimum(share, 1.0)[:, None]
    return steps
