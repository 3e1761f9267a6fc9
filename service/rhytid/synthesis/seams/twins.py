"""What is drawn in another chart, too: which elements, and how their UV go over into its own."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.borders import NONE, Borders
from rhytid.synthesis.seams.supports import Supports, times
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Twins:
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

    def take(self, index: IntArray | BoolArray) -> Twins:
        """Those of an index or a mask, in its order."""
        return Twins(*(getattr(self, field.name)[index] for field in fields(self)))

    def at(self, uv: FloatArray) -> FloatArray:
        """(T, 2) where a place (T, 2) of each element comes to lie."""
        there: FloatArray = np.einsum("nij,nj->ni", self.turn, uv) + self.shift
        return there

    def back(self, index: IntArray, uv: FloatArray) -> FloatArray:
        """(N, 2) what in the UV of its element lies at a place (N, 2) of the chart of twin (N,)."""
        inverse: FloatArray = np.linalg.inv(self.turn).astype(np.float64)
        x, y = (uv - self.shift[index]).T
        return np.stack(times(inverse[index], x, y), axis=-1)

    def charts(self, supports: Supports, borders: Borders) -> IntArray:
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

    def renamed(self, name: IntArray) -> Twins:
        """The same of elements that have other numbers: name (E,) of each."""
        return Twins(name[self.of], self.side, self.turn, self.shift, self.nearest)

    def sorted(self) -> Twins:
        """In the order of the elements."""
        return self.take(np.argsort(self.of, kind="stable"))

    @classmethod
    def join(cls, parts: list[Twins]) -> Twins:
        """All of them, one after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )

    @classmethod
    def originals(cls, of: IntArray) -> Twins:
        """The elements themselves."""
        count = len(of)
        none = np.full(count, NONE, np.int64)
        turn = np.tile(np.eye(2), (count, 1, 1))
        return cls(of, none, turn, np.zeros((count, 2)), np.zeros(count))
