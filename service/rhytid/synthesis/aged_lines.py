"""Lines that age draws over lines that are there.

No pore moves with age, so these lines cannot be laid before the pores as leaders are. Each follows
lines that are there already, from pore to pore the way that runs most nearly as it is to run, and
makes them deeper and broader.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.synthesis.lattice import nearest_within
from rhytid.synthesis.lines import Lines
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.shapes import WIDE
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points

Singles = NDArray[np.float32]
# How much longer a way counts that runs across, or along faint lines.
_ACROSS, _FAINT = 12.0, 0.25
# A way is looked for within so much of its length around its middle; by how much longer than
# straight it may be: what winds farther is a worm, and no line of skin.
_ROOM, _WINDING = 0.65, 1.08
# It ends where it runs best, so far along its course, and as far beside it as this times that.
_LEAST, _MOST, _ASIDE = 0.7, 1.05, 0.35


@dataclass(frozen=True)
class Look:
    """How lines of one kind look.

    rises, fades: shares of its length over which a line rises, and from where on it fades; begins:
    of its depth, what it begins with.  broad: half width of those of weight 1, in that of strength
    1.  quiet, beside: what of the weight of other lines is taken beside one, and how far from it,
    millimetres.
    """

    rises: float
    fades: float
    begins: float
    broad: float
    quiet: float
    beside: float

    def profile(self, at: FloatArray) -> FloatArray:
        """How deep a line is so far along it, 0 to 1: soon as deep as it is, then less and less."""
        rise = self.begins + (1.0 - self.begins) * np.clip(at / self.rises, 0.0, 1.0)
        fade = np.clip((1.0 - at) / (1.0 - self.fades), 0.0, 1.0)
        found: FloatArray = rise * fade * (2.0 - fade)
        return found


@dataclass(frozen=True, eq=False)
class AgedLine:
    """One line: the wrinkles (P,) that it follows, how far along it each is, 0 to 1, and how large
    it is and how worn skin is when it appears, 0 to 1."""

    line: IntArray
    at: FloatArray
    size: float
    onset: float

    def grown(self, worn: float) -> float:
        """How deep it is where it is deepest."""
        return self.size * min(max((worn - self.onset) / (1.0 - self.onset), 0.0), 1.0)


@dataclass(frozen=True, eq=False)
class AgedLines:
    """P parts of lines that age draws: wrinkles that they follow.

    line (P,): which wrinkles.  share (P,): how far each is part of one, 0 to 1: by age, rank and
    along the line.  beside (V,): the factor of the weight of all other wrinkles.  look: of these.
    """

    line: IntArray
    share: FloatArray
    beside: Singles
    look: Look

    @classmethod
    def of(
        cls,
        drawn: Iterable[AgedLine],
        look: Look,
        ways: Ways,
        worn: float,
        rank: float,
    ) -> AgedLines:
        """Those of skin so worn, 1 at 65.

        rank: how far lines have ranks, 1 at most: so deep are those of 1, and so much softer what
        is beside them.
        """
        every = list(drawn)
        share = [rank * part.grown(worn) * look.profile(part.at) for part in every]
        line = np.concatenate([np.empty(0, np.int64), *(part.line for part in every)])
        found = np.concatenate([np.empty(0), *share])
        return cls(line, found, ways.beside(line, look.quiet * found, look.beside), look)

    def drawn(
        self,
        lines: Lines,
        leads: BoolArray,
        sizes: tuple[Singles, ...],
        spacing: float,
    ) -> BoolArray:
        """Change lines (W,) in place: their weights, and their half widths on the surface and in
        UV; and which of them (W,) are parts of these, deeper than they were.

        leads (W,): which are parts of leaders.  spacing: of pores, on the surface.
        """
        weight, width, half_width = sizes
        share = np.zeros(lines.whole, np.float32)
        np.maximum.at(share, self.line, self.share.astype(np.float32))
        # Halves of a wrinkle that is cut at a seam are alike.
        of = np.append(np.arange(lines.whole), lines.copy_of[lines.whole :])
        found: BoolArray = np.empty(len(weight), np.bool_)
        broad = np.float32(self.look.broad * WIDE * spacing)

        def draw(rows: slice) -> None:
            deep, quiet = share[of[rows]], self.beside[of[rows]]
            found[rows] = deep > weight[rows]
            weight[rows] *= np.where(leads[rows] | found[rows], np.float32(1.0), quiet)
            np.maximum(weight[rows], deep, out=weight[rows])
            broader = np.maximum(broad * np.sqrt(deep) / width[rows], np.float32(1.0))
            width[rows] *= broader
            half_width[rows] *= broader

        over_rows(len(found), draw)
        return found


class Ways:
    """Finds ways along lines that there are.

    lines: of a graph.  weight (W,): of these.  around (N,): pores that ways may go over.
    millimetre: in units of the surface.
    """

    def __init__(
        self, pores: Points, lines: Lines, weight: Singles, around: BoolArray, millimetre: float
    ) -> None:
        self._millimetre, self._count = millimetre, lines.whole
        self._place, ends = pores.position, lines.pores[: lines.whole]
        inside = np.empty(lines.whole, np.bool_)

        def look(rows: slice) -> None:
            one, two = ends[rows].T
            inside[rows] = around[one] & around[two]

        over_rows(len(inside), look)
        self._line = np.flatnonzero(inside)
        self._ends = ends[self._line]
        one, two = (self._place[self._ends[:, end]] for end in (0, 1))
        self._step, self._middle = two - one, 0.5 * (one + two)
        self._faint = _FAINT / (_FAINT + weight[self._line].astype(np.float64))

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        # There may be millions: it is not worth balancing, and where lines are there none asks.
        return scipy.spatial.cKDTree(self._middle, balanced_tree=False, compact_nodes=False)

    def along(self, pore: int, course: FloatArray) -> tuple[IntArray, FloatArray] | None:
        """The lines on the way from a pore along a course (3,), and how far each is on it, 0 to 1;
        None where no way leads there that is nearly straight."""
        long, start = float(np.linalg.norm(course)), self._place[pore]
        near = self._tree.query_ball_point(start + 0.5 * course, _ROOM * long, return_sorted=True)
        rows = np.array(near, np.int64)
        pores, ends = np.unique(self._ends[rows], return_inverse=True)
        ends, first = ends.reshape(-1, 2), int(np.searchsorted(pores, pore))
        if first == len(pores) or pores[first] != pore:
            return None
        cost, before = self._costs(rows, ends, len(pores), first, course / long)
        last = _end(self._place[pores] - start, course, cost)
        if last is None:
            return None
        path = rows[_back(ends, before, last)]
        length = np.linalg.norm(self._step[path], axis=1)
        whole = float(length.sum())
        if whole > _WINDING * np.linalg.norm(self._place[pores[last]] - start):
            return None
        return self._line[path], (np.cumsum(length) - 0.5 * length) / whole

    def _costs(
        self, rows: IntArray, ends: IntArray, count: int, first: int, way: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """What ways from pore `first` of so many take at least to each, and the pore before it."""
        length = np.linalg.norm(self._step[rows], axis=1)
        across = 1.0 - (self._step[rows] @ way / length) ** 2
        cost = length * (1.0 + _ACROSS * across) * (1.0 + self._faint[rows])
        net = scipy.sparse.csr_array((cost, ends.T), shape=(count, count))
        found: tuple[FloatArray, IntArray] = scipy.sparse.csgraph.dijkstra(
            net, directed=False, indices=first, return_predecessors=True
        )
        return found

    def beside(self, line: IntArray, quiet: FloatArray, reach: float) -> Singles:
        """(V,) factors of the weights of V wrinkles beside `line` (P,), each of which takes of
        these `quiet` (P,) within `reach` millimetres."""
        reach *= self._millimetre
        found = np.ones(self._count, np.float32)
        if not len(line):
            return found
        tree = scipy.spatial.cKDTree(self._middle[np.searchsorted(self._line, line)])
        near, distance, nearest = nearest_within(tree, self._middle, reach)
        close = 1.0 - (distance / reach) ** 2
        found[self._line[near]] = 1.0 - close * quiet[nearest]
        return found


def _end(step: FloatArray, course: FloatArray, cost: FloatArray) -> int | None:
    """Which pore, at steps (M, 3) from the first, a way along a course (3,) ends at, by what ways
    to each take (M,): where it takes least for the square of how far it comes, so that it rather is
    long; None where none is in reach."""
    long = float(np.linalg.norm(course))
    far = step @ course / long
    aside = np.linalg.norm(step - far[:, None] * course / long, axis=1)
    reach = (far > _LEAST * long) & (far < _MOST * long) & (aside < _ASIDE * far)
    if not (reach & np.isfinite(cost)).any():
        return None
    return int(np.where(reach, cost / np.maximum(far, _LEAST * long) ** 2, np.inf).argmin())


def _back(ends: IntArray, before: IntArray, last: int) -> IntArray:
    """Numbers of the lines, which join pores `ends` (R, 2), on the way to pore `last`, from its
    beginning on.  before (M,): the pore before each."""
    number = {frozenset(pair): row for row, pair in enumerate(ends.tolist())}
    found = []
    while before[last] >= 0:
        found.append(number[frozenset((last, int(before[last])))])
        last = int(before[last])
    return np.array(found[::-1], np.int64)
