"""Positions of a face out of the weights of its shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.shape_names import meant_shapes
from rhytid.errors import FrameError, InputError

# Beyond it a weight is a mistake, and not a face that is pushed far.
MOST_WEIGHT = 1000.0


class Blendshapes:
    """Turns weights, in the order of the names that a caller gives them by, into positions.

    neutral: (V, 3).  names: of the weights; empty = those of the shapes, in their order.  unknown:
    of these names, those that mean none of the shapes; their weights have no effect.

    Raises InputError where none of the names means a shape.
    """

    def __init__(
        self, neutral: NDArray[np.float32], shapes: Expressions, names: Sequence[str] = ()
    ) -> None:
        self.names = tuple(names) or shapes.names
        meant = meant_shapes(self.names, shapes.names)
        self.unknown = tuple(n for n, found in zip(self.names, meant, strict=True) if not found)
        if len(self.unknown) == len(self.names):
            known = ", ".join(shapes.names[:8])
            raise InputError(f"none of the shapes {', '.join(self.names[:8])} is known: {known}, …")
        used = sorted({index for found in meant for index in found})
        self._neutral = neutral
        # One row of differences for each shape that some weight moves.
        self._differences = (shapes.positions[used] - neutral).reshape(len(used), -1)
        self._spread = np.zeros((len(used), len(self.names)), np.float32)
        for column, found in enumerate(meant):
            for index in found:
                self._spread[used.index(index), column] = 1.0

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self._differences.nbytes + self._spread.nbytes + self._neutral.nbytes

    def positions(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, 3) = neutral + Σ wₑ (shapeₑ - neutral), of as many weights as there are names.

        Raises FrameError naming the first weight that is not finite or beyond ± 1000.
        """
        with np.errstate(invalid="ignore"):
            good = np.abs(weights) <= MOST_WEIGHT
        if not good.all():
            first = int(np.argmin(good))
            raise FrameError(
                f"weight of {self.names[first]} is {float(weights[first]):g}: must be a number "
                f"within ± {MOST_WEIGHT:g}"
            )
        # Not a product of matrices: BLAS would take several threads, which wait for each other.
        moved = np.einsum("e,ev->v", self._spread @ weights, self._differences)
        found: NDArray[np.float32] = self._neutral + moved.reshape(self._neutral.shape)
        return found
