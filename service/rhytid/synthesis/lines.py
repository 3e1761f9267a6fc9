"""Wrinkles as they are stored, each on the chart of one of its pores, and how they continue one
another as one line: shared tangents, strengths and widths. Kernel: continuations.cl.

Pairs that continue one another are found on whole wrinkles, by their pores on the surface. What is
stored of a wrinkle, all of it or, where it is cut at a seam, a half on either side, is given the
result afterwards. Copies take what their originals have (seams/copies.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import LEAST_SIZE, ORIGINAL, STEEPEST
from rhytid.synthesis.candidate_graph import CandidateGraph, Ground
from rhytid.synthesis.edges import DEFINES
from rhytid.synthesis.incidence import Incidence
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.charts import BORDER, Halves, halves, side_at
from rhytid.synthesis.shapes import WIDE, half_widths_uv
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, unit

Indices = NDArray[np.int32]
# A wrinkle whose far pore, laid flat, is so much nearer or farther than on the surface is cut at
# the seam: the charts meet in a corner there.
_BEND = 2.0
Singles = NDArray[np.float32]
# Lines that turn by up to 60 degrees go on as one.
LEAST_COSINE = 0.5
# Strength, and half width, of a wrinkle where it ends on others, and where nothing else is, as
# shares of its own.
ON_OTHERS, ALONE = (0.6, 0.8), (0.0, 0.5)
# What the kernel answers for an end with no partner, where others meet; one less where none do.
NOTHING = -1
# What lines that go before others are heavier by: more than any weight.
_BEFORE = np.float32(4.0)


@dataclass(frozen=True, eq=False)
class Lines:
    """W stored lines, and the S nodes that some of them need beyond a border.

    edge (W,): the candidate edge that each line draws.  pores (W, 2): that it joins.  nodes (W, 2):
    that it ends at, pores first, then the nodes beyond a border from number N on.  step (W, 2):
    from the first node to the second in UV.  triangle (W,): that it samples.  copy_of (W,):
    ORIGINAL; or for the second half of a wrinkle that is cut at a seam, the line that is the first.
    owner (S,): the pore whose chart each node beyond a border lies on.  stands_for (S,): the pore
    whose place the node takes.  beyond (S, 2): uv of the node.  turn (S, 2, 2): from steps in the
    chart of the pore that the node stands for to steps in UV at the node.
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
    """The lines of edges (E,) of a net. A line across a seam lies on the chart with its middle.

    spacing: of pores on even skin, in units of the surface.
    """
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
    """The longer halves of wrinkles across a seam. Their nodes (W, 2) are turned in place, so that
    each starts with its longer half."""
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
    """(S, 2) UV steps to the second pore with the two triangles at the seam laid flat, (S,) whether
    that step is known, and (S, 2, 2) how steps at that pore turn with the triangles."""
    surface, (owner, other) = ground.surface, nodes.T
    row = borders.row[half.last, side_at(surface.uv[half.last], half.exit_uv)]
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


def _over_the_border(ground: Ground, pores: Points, nodes: Indices, spacing: float) -> FloatArray:
    """(S, 2) UV steps that hide the round end of the widest line, but go no further."""
    half = halves(ground.surface, ground.across, pores, nodes)
    widest = np.full(len(nodes), WIDE * spacing)
    end = half_widths_uv(ground.surface, pores.triangle[nodes[:, 0]], half.step, widest)
    share = half.share + end / np.linalg.norm(half.step, axis=-1)
    steps: FloatArray = half.step * np.minimum(share, 1.0)[:, None]
    return steps


@dataclass(frozen=True, eq=False)
class Ends:
    """Values of W stored lines at their first node and at their second, as in WrinkleGraph."""

    slopes: Singles
    weights: Singles
    half_widths: Singles
    partners: Indices

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by their names in a graph."""
        return {
            "edge_slopes": self.slopes,
            "edge_end_weights": self.weights,
            "edge_end_half_widths": self.half_widths,
            "edge_partners": self.partners,
        }


def ends_of(
    ground: Ground,
    pores: Points,
    lines: Lines,
    weight: Singles,
    half_width: Singles,
    width: Singles,
    leads: BoolArray | None = None,
) -> Ends:
    """The values of the stored lines at their ends, and the lines that continue them there.

    weight, half_width (W,): of each line.  width (W,): half width on the surface. Where a line
    continues another, both have the means of the two at their common pore. A line that ends on
    others, or alone, has less there.  leads (W,): lines that continue one another before all
    others do. At a seam a line goes straight over to its other half.
    """
    wholes = _WholeWrinkles.of(lines)
    before = weight if leads is None else weight + _BEFORE * leads
    partner, slope = _paired(ground, pores, lines, wholes, before)
    slopes = np.zeros((len(weight), 2), np.float32)
    partners = np.full((len(weight), 2), NOTHING, np.int32)
    slopes[wholes.row, wholes.place] = slope
    of_end = wholes.row.ravel()[np.maximum(partner, 0)]
    partners[wholes.row, wholes.place] = np.where(partner >= 0, of_end, partner)
    both = np.flatnonzero(wholes.row[:, 0] != wholes.row[:, 1])
    one, two = wholes.row[both].T
    partners[one, 1], partners[two, 0] = two, one
    weights, widths = _at_ends(weight, partners, 0), _at_ends(width, partners, 1)
    for values in (weights, widths):  # halves meet with the mean of their pores' ends
        values[one, 1] = values[two, 0] = 0.5 * (values[one, 0] + values[two, 1])
    return Ends(
        slopes,
        np.clip(weights, 0.0, 1.0),
        np.clip(widths * (half_width / width)[:, None], np.float32(LEAST_SIZE), 1.0),
        np.maximum(partners, NOTHING),
    )


def _at_ends(values: Singles, partners: Indices, k: int) -> Singles:
    """(W, 2) values at ends: the mean of a line and its partner; without a partner, share `k` of
    the line's own."""
    found = np.empty(partners.shape, np.float32)
    for rows in row_blocks(len(values)):
        own, other = values[rows, None], partners[rows]
        share = np.where(other == NOTHING, np.float32(ON_OTHERS[k]), np.float32(ALONE[k]))
        mean = np.float32(0.5) * (own + values[np.maximum(other, 0)])
        found[rows] = np.where(other >= 0, mean, share * own)
    return found


@dataclass(frozen=True, eq=False)
class _WholeWrinkles:
    """V whole wrinkles, each stored as one line or as two halves.

    row (V, 2): the stored line at either pore, twice the same unless there are two halves.
    place (V, 2): which end of that line the pore is.  nodes (V, 2): the pores.  out (V, 2, 2): UV
    steps away from either pore, on the chart of the line.
    """

    row: Indices
    place: Indices
    nodes: Indices
    out: Singles

    @classmethod
    def of(cls, lines: Lines) -> _WholeWrinkles:
        first = np.flatnonzero(lines.copy_of == ORIGINAL).astype(np.int32)
        row = np.repeat(first, 2).reshape(-1, 2)
        half = np.flatnonzero(lines.copy_of != ORIGINAL).astype(np.int32)
        row[lines.copy_of[half], 1] = half  # originals are the first rows
        # A half is stored from the seam on to its pore, so that this is its second end, too.
        place = np.tile(np.array([0, 1], np.int32), (len(row), 1))
        out = np.stack([lines.step[row[:, 0]], -lines.step[row[:, 1]]], axis=1)
        return cls(row, place, lines.pores[first], out.astype(np.float32))


def _paired(
    ground: Ground, pores: Points, lines: Lines, wholes: _WholeWrinkles, weight: Singles
) -> tuple[Indices, Singles]:
    """(V, 2) the end that continues each end, counted over all wrinkles, and (V, 2) slopes
    there."""
    count, nodes = len(wholes.nodes), wholes.nodes
    way = np.empty((count, 3), np.float32)
    for rows in row_blocks(count):
        way[rows] = unit(pores.position[nodes[rows, 1]] - pores.position[nodes[rows, 0]])
    triangles, to_uv = _charts(ground, pores, lines, wholes)
    arrays = (way, weight[wholes.row[:, 0]], pores.normal.astype(np.float32))
    with ground.work.nested() as work:
        members, triangle = work.upload(nodes), work.upload(triangles)
        lists = Incidence.of(work, members, count, len(pores))
        partner, slope = work.full(2 * count, np.int32(-2)), work.full(2 * count, np.float32(0))
        work.run(
            "continuations", "pair_lines", len(pores), lists.offsets, lists.pairs, members,
            *(work.upload(a) for a in arrays), triangle, work.upload(to_uv),
            work.upload(wholes.out), LEAST_COSINE, STEEPEST, partner, slope, defines=DEFINES,
        )  # fmt: skip
        return work.read(partner, (count, 2), np.int32), work.read(slope, (count, 2), np.float32)


def _charts(
    ground: Ground, pores: Points, lines: Lines, wholes: _WholeWrinkles
) -> tuple[Indices, Singles]:
    """(V, 2) for each end a row of the second result, (R, 2, 3): matrices from steps in space at
    its pore to the UV of the chart that its line is stored on. A matrix is that of the pore's
    triangle, turned over the seam where the line is stored on another chart."""
    to_uv = np.linalg.pinv(ground.surface.jacobian)
    triangle = pores.triangle[wholes.nodes].astype(np.int32)
    whole = np.flatnonzero(wholes.row[:, 0] == wholes.row[:, 1])
    beyond = lines.nodes[wholes.row[whole, 1], 1] - len(pores)
    over, beyond = whole[beyond >= 0], beyond[beyond >= 0]
    turned = lines.turn[beyond] @ to_uv[triangle[over, 1]]
    triangle[over, 1] = len(to_uv) + np.arange(len(over))
    return triangle, np.concatenate([to_uv, turned]).astype(np.float32)
