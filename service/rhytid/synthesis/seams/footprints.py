"""The regions of UV that pores and wrinkles cover, and their placements in other charts."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Footprints:
    """The regions of UV that E elements, pores and wrinkles, cover.

    start, step (E, 2): the segment in UV; the step of a pore is 0.  root (E, 2, 2): the rim is
    where |root·d| = 1.  chart (E,): that each element lies on.  widest (E,): how many times as
    large as neutral it becomes at most.  slopes (E, 2): of the arc over the step, in the metric in
    which the footprint is round.
    """

    start: FloatArray
    step: FloatArray
    root: FloatArray
    chart: IntArray
    widest: FloatArray
    slopes: FloatArray

    def __len__(self) -> int:
        return len(self.start)

    def take(self, index: IntArray | BoolArray | slice) -> Footprints:
        """The footprints of an index or a mask, in its order."""
        return Footprints(*(getattr(self, field.name)[index] for field in fields(self)))

    def straight(self) -> Footprints:
        """The same footprints without their bends."""
        return replace(self, slopes=np.zeros_like(self.slopes))

    def distance(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N,) distances from elements `index` (N,) to places uv (N, 2), in neutral sizes of each
        element. Of an arc the point counts that lies over the nearest point of its chord."""
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
        """(N,) how far an arc lies to the left of its chord at a share of it, in chords."""
        start, stop = self.slopes[index].T
        aside: FloatArray = share * (1 - share) * (start * (1 - share) - stop * share)
        return aside

    def middle(self) -> FloatArray:
        """(E, 2) the centre of each footprint."""
        middle: FloatArray = self.start + 0.5 * self.step
        return middle

    def reach(self) -> FloatArray:
        """(E,) how far each footprint goes from its centre in UV, at its widest."""
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
    """T places where elements are drawn: each in its own chart, or in another across a seam.

    of (T,): the element.  side (T,): the row in `Borders` of the side of the seam that it comes
    over, on the chart that it comes from; NONE in its own chart.  turn (T, 2, 2), shift (T, 2):
    from the UV of the element to those of the chart, uv -> turn·uv + shift.  nearest (T,): how far
    that seam is from the element, in its own sizes.
    """

    of: IntArray
    side: IntArray
    turn: FloatArray
    shift: FloatArray
    nearest: FloatArray

    def __len__(self) -> int:
        return len(self.of)

    def take(self, index: IntArray | BoolArray) -> Placements:
        """The placements of an index or a mask, in its order."""
        return Placements(*(getattr(self, field.name)[index] for field in fields(self)))

    def at(self, uv: FloatArray) -> FloatArray:
        """(T, 2) where a place uv (T, 2) in the UV of each element lies in its chart here."""
        there: FloatArray = np.einsum("nij,nj->ni", self.turn, uv) + self.shift
        return there

    def back(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N, 2) places in the UV of the elements, from places uv (N, 2) of the charts of
        placements `index` (N,)."""
        inverse: FloatArray = np.linalg.inv(self.turn).astype(np.float64)
        x, y = (uv - self.shift[index]).T
        return np.stack(times(inverse[index], x, y), axis=-1)

    def charts(self, footprints: Footprints, borders: Borders) -> IntArray:
        """(T,) the chart in which each placement is drawn."""
        mate = borders.triangle[borders.mate[self.side]]
        charts: IntArray = np.where(
            self.side == NONE, footprints.chart[self.of], borders.chart[mate]
        )
        return charts

    def growth(self) -> FloatArray:
        """(T,) UV length in the other chart per UV length, the mean of both directions."""
        growth: FloatArray = np.sqrt(np.abs(np.linalg.det(self.turn)))
        return growth

    def landing(self, borders: Borders) -> NDArray[np.int32]:
        """(T,) the triangle across the seam."""
        return borders.triangle[borders.mate[self.side]].astype(np.int32)

    def renamed(self, name: IntArray) -> Placements:
        """The same placements where element e has the number name[e]."""
        return Placements(name[self.of], self.side, self.turn, self.shift, self.nearest)

    def sorted(self) -> Placements:
        """The placements in the order of their elements."""
        return self.take(np.argsort(self.of, kind="stable"))

    @classmethod
    def join(cls, parts: list[Placements]) -> Placements:
        """The placements of all parts, one part after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )

    @classmethod
    def originals(cls, of: IntArray) -> Placements:
        """Elements `of` (T,) in their own charts."""
        count = len(of)
        none = np.full(count, NONE, np.int64)
        turn = np.tile(np.eye(2), (count, 1, 1))
        return cls(of, none, turn, np.zeros((count, 2)), np.zeros(count))
