"""Pores and wrinkles as regions of UV: how far they reach, in sizes of their own."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Supports:
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

    def take(self, index: IntArray | BoolArray | slice) -> Supports:
        """Those of an index or a mask, in its order."""
        return Supports(*(getattr(self, field.name)[index] for field in fields(self)))

    def straight(self) -> Supports:
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
