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
from rhytid.synthesis.progress import gathered, over_rows, rows_where
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
# Pores whose lines are paired at a time.
_PORES = 1 << 20


@dataclass(frozen=True, eq=False)
class Lines:
    """W stored lines, second halves of wrinkles last, and the S nodes that some of them need beyond
    a border.

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

    @property
    def whole(self) -> int:
        """V, the number of wrinkles: so many lines are no second halves."""
        return len(self.edge) - int(np.count_nonzero(self.copy_of != ORIGINAL))


def draw(
    ground: Ground, net: CandidateGraph, borders: Borders, edge: Indices, spacing: float
) -> Lines:
    """The lines of edges (E,) of a net. A line across a seam lies on the chart with its middle.

    spacing: of pores on even skin, in units of the surface.
    """
    joined, pores = gathered(net.edges.nodes, edge), net.pores
    triangle = gathered(net.edges.middle, edge)
    split = np.flatnonzero(triangle == BORDER)
    half = _turned_to_middle(ground, pores, joined, split)
    step = np.empty((len(edge), 2), np.float32)

    def measure(rows: slice) -> None:
        step[rows] = pores.uv[joined[rows, 1]] - pores.uv[joined[rows, 0]]

    over_rows(len(edge), measure)
    triangle[split] = np.where(half.middle == BORDER, half.last, half.middle)
    owner, other = joined[split].T
    flat, whole, turn = _laid_flat(ground, pores, borders, joined[split], half)
    step[split] = flat
    cut = split[~whole]
    step[cut] = _over_the_border(ground, pores, joined[cut], spacing)
    nodes, count = joined.copy() if len(split) else joined, len(pores)
    nodes[split, 1] = count + np.arange(len(split))
    # Of a cut one the other half, from the seam on to the other pore.
    back = -_over_the_border(ground, pores, joined[cut, ::-1], spacing)
    ends = np.stack([count + len(split) + np.arange(len(cut)), joined[cut, 1]], axis=1)
    return Lines(
        _with(edge, edge[cut]),
        _with(joined, joined[cut]),
        _with(nodes, ends),
        _with(step, back),
        _with(triangle, pores.triangle[joined[cut, 1]]),
        _with(np.full(len(edge), ORIGINAL, np.int32), cut),
        np.concatenate([owner, joined[cut, 1]]),
        np.concatenate([other, joined[cut, 0]]),
        np.concatenate([pores.uv[owner] + step[split], pores.uv[joined[cut, 1]] - back]).astype(
            np.float32
        ),
        np.concatenate([turn, turn[~whole]]),
    )


def _with(array: NDArray[Any], more: NDArray[Any]) -> NDArray[Any]:
    """An array with more rows, in its own kind of numbers; itself without any."""
    return np.concatenate([array, more.astype(array.dtype)]) if len(more) else array


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


@dataclass(frozen=True, eq=False)
class Joins:
    """How W stored lines continue one another at their ends: slopes (W, 2) and partners (W, 2),
    below 0 for none."""

    slopes: Singles
    partners: Indices


def joins_of(
    ground: Ground, pores: Points, lines: Lines, weight: Singles, leads: BoolArray | None = None
) -> Joins:
    """The lines that continue one another.

    weight (W,): of each; heavy ones come first.  leads (W,): lines that continue one another before
    all others do. At a seam a line goes straight over to its other half.
    """
    before = weight if leads is None else weight + _BEFORE * leads
    slopes, partners = _paired(ground, pores, lines, before)
    two = np.arange(lines.whole, len(weight), dtype=np.int32)
    one = lines.copy_of[two]
    slopes[two, 1], slopes[one, 1] = slopes[one, 1], 0.0
    partners[two, 1], partners[one, 1], partners[two, 0] = partners[one, 1], two, one
    return Joins(slopes, partners)


def ends_of(
    lines: Lines, joins: Joins, weight: Singles, half_width: Singles, width: Singles
) -> Ends:
    """The values of the stored lines at their ends, and the lines that continue them there.

    weight, half_width (W,): of each line.  width (W,): half width on the surface. Where a line
    continues another, both have the means of the two at their common pore. A line that ends on
    others, or alone, has less there.
    """
    partners, two = joins.partners, np.arange(lines.whole, len(weight), dtype=np.int32)
    one = lines.copy_of[two]
    weights, widths = _at_ends(weight, partners, 0), _at_ends(width, partners, 1)
    for values in (weights, widths):  # halves meet with the mean of their pores' ends
        values[one, 1] = values[two, 0] = 0.5 * (values[one, 0] + values[two, 1])
    others = np.empty_like(partners)

    def limit(rows: slice) -> None:
        widths[rows] *= (half_width[rows] / width[rows])[:, None]
        np.clip(weights[rows], 0.0, 1.0, out=weights[rows])
        np.clip(widths[rows], np.float32(LEAST_SIZE), 1.0, out=widths[rows])
        others[rows] = np.maximum(partners[rows], NOTHING)

    over_rows(len(weight), limit)
    return Ends(joins.slopes, weights, widths, others)


def _at_ends(values: Singles, partners: Indices, k: int) -> Singles:
    """(W, 2) values at ends: the mean of a line and its partner; without a partner, share `k` of
    the line's own."""
    found = np.empty(partners.shape, np.float32)

    def find(rows: slice) -> None:
        own, other = values[rows, None], partners[rows]
        share = np.where(other == NOTHING, np.float32(ON_OTHERS[k]), np.float32(ALONE[k]))
        mean = np.float32(0.5) * (own + values[np.maximum(other, 0)])
        found[rows] = np.where(other >= 0, mean, share * own)

    over_rows(len(values), find)
    return found


def _paired(
    ground: Ground, pores: Points, lines: Lines, weight: Singles
) -> tuple[Singles, Indices]:
    """(W, 2) slopes, and (W, 2) the lines that continue each, of wrinkles at their two pores, those
    of second halves at their first line.

    _PORES are looked at together, with no other wrinkles and normals than theirs on the device.
    """
    count = lines.whole
    slopes = np.zeros((len(weight), 2), np.float32)
    partners = np.full((len(weight), 2), NOTHING, np.int32)
    partners[:count] = NOTHING - 1
    charts = _Charts.of(ground, pores, lines)
    for first in range(0, len(pores), _PORES):
        number = min(_PORES, len(pores) - first)
        wrinkles, here = _ending_at(lines.pores[:count], first, number)
        stored = _stored(lines, wrinkles)
        found = _paired_at(ground, pores, lines, charts, stored, weight, wrinkles, first, number)
        _give(found, stored, wrinkles, here, slopes, partners)
    return slopes, partners


def _ending_at(pores: Indices, first: int, number: int) -> tuple[Indices, BoolArray]:
    """The wrinkles (K,) that end at pores `first` to `first + number`, ascending, and (K, 2) which
    of their ends do.  pores (V, 2): of all wrinkles."""

    def here(ends: Indices) -> BoolArray:
        found: BoolArray = (ends >= first) & (ends < first + number)
        return found

    def ends_here(rows: slice) -> BoolArray:
        ends = here(pores[rows])
        found: BoolArray = ends[:, 0] | ends[:, 1]
        return found

    wrinkles = rows_where(len(pores), ends_here)
    return wrinkles, here(gathered(pores, wrinkles))


def _give(
    found: tuple[Indices, Singles],
    stored: Indices,
    wrinkles: Indices,
    here: BoolArray,
    slopes: Singles,
    partners: Indices,
) -> None:
    """Put what was found of wrinkles (K,) where they are `here` (K, 2) into the arrays of all."""
    partner, slope = found

    def give(rows: slice) -> None:
        some = partner[rows]
        end = np.where(some >= 0, stored[some // 2, some % 2], some)
        for side in (0, 1):
            which = here[rows, side]
            at = wrinkles[rows][which]
            partners[at, side] = end[which, side]
            slopes[at, side] = slope[rows, side][which]

    over_rows(len(wrinkles), give)


def _stored(lines: Lines, wrinkles: Indices) -> Indices:
    """(K, 2) the stored line of wrinkles (K,) at either pore, the same twice unless there are
    two."""
    row = np.repeat(wrinkles, 2).reshape(-1, 2)
    at, which = _common(wrinkles, lines.copy_of[lines.whole :])
    row[at, 1] = lines.whole + which
    return row


def _common(wrinkles: Indices, some: NDArray[np.integer]) -> tuple[IntArray, IntArray]:
    """Where those of `some` that are among wrinkles (K,) are in both; both ascend."""
    at = np.minimum(np.searchsorted(wrinkles, some), max(len(wrinkles) - 1, 0))
    which = np.flatnonzero(wrinkles[at] == some) if len(wrinkles) else np.zeros(0, np.int64)
    return at[which], which


def _paired_at(
    ground: Ground,
    pores: Points,
    lines: Lines,
    charts: _Charts,
    stored: Indices,
    weight: Singles,
    wrinkles: Indices,
    first: int,
    number: int,
) -> tuple[Indices, Singles]:
    """(K, 2) the end that continues each end of wrinkles (K,), counted over these, and (K, 2)
    slopes there; right at pores `first` to `first + number`, whose wrinkles all are among these."""
    count, nodes = len(wrinkles), gathered(lines.pores, wrinkles)
    way, out = np.empty((count, 3), np.float32), np.empty((count, 2, 2), np.float32)

    def find(rows: slice) -> None:
        way[rows] = unit(pores.position[nodes[rows, 1]] - pores.position[nodes[rows, 0]])
        out[rows, 0] = lines.step[wrinkles[rows]]
        out[rows, 1] = -lines.step[stored[rows, 1]]

    over_rows(count, find)
    normal = pores.normal[first : first + number].astype(np.float32, copy=False)
    triangle = charts.of_ends(pores, wrinkles, nodes)
    arrays = way, weight[wrinkles], normal, triangle, charts.to_uv, out
    nodes, things = _counted_from(first, number, nodes)
    with ground.work.nested() as work:
        members = work.lend(nodes)
        lists = Incidence.of(work, members, count, things)
        partner, slope = work.full(2 * count, np.int32(-2)), work.full(2 * count, np.float32(0))
        work.run(
            "continuations", "pair_lines", number, lists.offsets, lists.pairs, members,
            *(work.lend(a) for a in arrays), LEAST_COSINE, STEEPEST, partner, slope,
            defines=DEFINES,
        )  # fmt: skip
        return work.read(partner, (count, 2), np.int32), work.read(slope, (count, 2), np.float32)


def _counted_from(first: int, number: int, nodes: Indices) -> tuple[Indices, int]:
    """(K, 2) pores counted from `first` on, with a number of its own for each end at none of so
    many, and how many numbers there are."""
    nodes = nodes - np.int32(first)
    beyond = np.flatnonzero((nodes < 0) | (nodes >= number))
    nodes.ravel()[beyond] = np.arange(number, number + len(beyond))
    return nodes, number + len(beyond)


@dataclass(frozen=True, eq=False)
class _Charts:
    """The charts that lines are stored on.

    to_uv (R, 2, 3) float32: matrices from steps in space to UV, of each triangle, then those of
    pores beyond a seam, turned over it.  over (K,): the wrinkles that have such a pore as their
    second, ascending, as these matrices are.  triangles: how many there are.
    """

    to_uv: Singles
    over: IntArray
    triangles: int

    @classmethod
    def of(cls, ground: Ground, pores: Points, lines: Lines) -> _Charts:
        """Those of lines. A wrinkle in two halves has each on the chart of its pore."""
        to_uv = np.linalg.pinv(ground.surface.jacobian)
        beyond = lines.nodes[: lines.whole, 1] >= len(pores)
        beyond[lines.copy_of[lines.whole :]] = False
        over = np.flatnonzero(beyond)
        at = pores.triangle[lines.pores[over, 1]]
        turned = lines.turn[lines.nodes[over, 1] - len(pores)] @ to_uv[at]
        return cls(np.concatenate([to_uv, turned]).astype(np.float32), over, len(to_uv))

    def of_ends(self, pores: Points, wrinkles: Indices, nodes: Indices) -> Indices:
        """(K, 2) rows of `to_uv`, for the ends of wrinkles (K,), ascending, at pores (K, 2)."""
        rows = pores.triangle[nodes].astype(np.int32, copy=False)
        at, which = _common(wrinkles, self.over)
        rows[at, 1] = self.triangles + which
        return rows
