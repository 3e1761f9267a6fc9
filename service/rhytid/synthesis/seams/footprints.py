"""What pores and wrinkles cover of UV, and where they lie in other charts."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Footprints:
    """E elements as they are drawn: start (E, 2) and step (E, 2) in UV, step 0 for a pore; root
    (E, 2, 2): the rim is where |root·d| = 1; chart (E,); widest (E,): at their widest they are so
    many times as large; slopes (E, 2): of arcs over the steps, where supports are round."""

    start: FloatArray
    step: FloatArray
    root: FloatArray
    chart: IntArray
    widest: FloatArray
    slopes: FloatArray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, index: IntArray | BoolArray | slice) -> Footprints:
        """Those of an index or a mask, in its order."""
        return Footprints(*(getattr(self, field.name)[index] for field in fields(self)))

    def straight(self) -> Footprints:
        """The same without their bends."""
        return replace(self, slopes=np.zeros_like(self.slopes))

    def distance(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N,) from elements (N,) to places (N, 2), in units of their own neutral size; to the
        point of an arc that is over the nearest of its chord."""
        # By components: there are millions of places, and small matrices take long.
        x, y = times(self.root[index], *(uv - self.start[index]).T)
        step = np.einsum("eij,ej->ei", self.root, self.step)
        length2 = (step * step).sum(-1)
        length2 = np.where(length2 > 0, length2, 1.0)[index]
        along, up = step[index].T
        share = np.clip((x * along + y * up) / length2, 0.0, 1.0)
        aside = self._aside(index, share)
        x, y = x - share * along + aside * up, y - share * up - aside * along
        distance: FloatArray = np.sqrt(x * x + y * y)
        return distance

    def _aside(self, index: IntArray, share: FloatArray) -> FloatArray:
        """(N,) how far to its left an arc is at a share of its chord, in chords."""
        start, stop = self.slopes[index].T
        aside: FloatArray = share * (1 - share) * (start * (1 - share) - stop * share)
        return aside

    def middle(self) -> FloatArray:
        """(E, 2) where they are centred."""
        middle: FloatArray = self.start + 0.5 * self.step
        return middle

    def reach(self) -> FloatArray:
        """(E,) how far from there they go in UV at their widest."""
        # Singular values in closed form: for every element of a graph a decomposition takes long.
        square, det = (self.root**2).sum(axis=(1, 2)), np.abs(np.linalg.det(self.root))
        largest2 = 0.5 * (square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0.0)))
        smallest = det / np.sqrt(largest2)
        # An arc is at most 4/27 of its chord aside for each of its slopes.
        chord = np.linalg.norm(np.einsum("eij,ej->ei", self.root, self.step), axis=-1)
        aside = 4 / 27 * np.abs(self.slopes).sum(axis=1) * chord
        half = 0.5 * np.linalg.norm(self.step, axis=-1)
        reach: FloatArray = half + (self.widest + aside) / smallest
        return reach


def times(matrix: FloatArray, x: Floats, y: Floats) -> tuple[FloatArray, FloatArray]:
    """The components (N,) of matrices (N, 2, 2) times vectors of components x, y (N,)."""
    return (
        matrix[:, 0, 0] * x + matrix[:, 0, 1] * y,
        matrix[:, 1, 0] * x + matrix[:, 1, 1] * y,
    )


@dataclass(frozen=True, eq=False)
class Placements:
    """T elements that are drawn in another chart, too.

    of (T,): the element.  side (T,): the row of the side of the seam that it comes over, on the
    chart that it comes from.  turn (T, 2, 2), shift (T, 2): from the UV of the element to those of
    the chart, uv -> turn·uv + shift.  nearest (T,): how far that seam is from it, in its own
    sizes.
    """

    of: IntArray
    side: IntArray
    turn: FloatArray
    shift: FloatArray
    nearest: FloatArray

    def __len__(self) -> int:
        return len(self.of)

    def take(self, index: IntArray | BoolArray) -> Placements:
        """Those of an index or a mask, in its order."""
        return Placements(*(getattr(self, field.name)[index] for field in fields(self)))

    def at(self, uv: FloatArray) -> FloatArray:
        """(T, 2) where a place (T, 2) of each element comes to lie."""
        there: FloatArray = np.einsum("nij,nj->ni", self.turn, uv) + self.shift
        return there

    def back(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N, 2) what in the UV of its element lies at a place (N, 2) of the chart of twin (N,)."""
        inverse: FloatArray = np.linalg.inv(self.turn).astype(np.float64)
        x, y = (uv - self.shift[index]).T
        return np.stack(times(inverse[index], x, y), axis=-1)

    def charts(self, supports: Footprints, borders: Borders) -> IntArray:
        """(T,) the chart in which each is drawn."""
        mate = borders.triangle[borders.mate[self.side]]
        charts: IntArray = np.where(self.side == NONE, supports.chart[self.of], borders.chart[mate])
        return charts

    def growth(self) -> FloatArray:
        """(T,) UV length in the other chart per UV length, the mean of both directions."""
        growth: FloatArray = np.sqrt(np.abs(np.linalg.det(self.turn)))
        return growth

    def landing(self, borders: Borders) -> NDArray[np.int32]:
        """(T,) the triangle across the seam."""
        return borders.triangle[borders.mate[self.side]].astype(np.int32)

    def renamed(self, name: IntArray) -> Placements:
        """The same of elements that have other numbers: name (E,) of each."""
        return Placements(name[self.of], self.side, self.turn, self.shift, self.nearest)

    def sorted(self) -> Placements:
        """In the order of the elements."""
        return self.take(np.argsort(self.of, kind="stable"))

    @classmethod
    def join(cls, parts: list[Placements]) -> Placements:
        """All of them, one after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )

    @classmethod
    def originals(cls, of: IntArray) -> Placements:
        """The elements themselves."""
        count = len(of)
        none = np.full(count, NONE, np.int64)
        turn = np.tile(np.eye(2), (count, 1, 1))
        return cls(of, none, turn, np.zeros((count, 2)), np.zeros(count))
