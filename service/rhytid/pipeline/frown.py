"""Where a frown presses skin most: two upright crests left and right of the middle of the brows.

Expressions move one brow each, and a frown moves both. Between the brows both press the same skin,
so that a mean over expressions, each by itself, has its crests farther out than a frown has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.blendshapes import LEFT, RIGHT, frowning_side
from rhytid.domain.expressions import form
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.diffusion import Diffusion
from rhytid.pipeline.region_masks import ramp

FloatArray = NDArray[np.float64]
# The vertical axis of a mesh; its cross product with a normal is level.
_UP = np.array([0.0, 1.0, 0.0])
# A crest stands out of what is around it: both smoothed, by these shares of the length of folds;
# how far, of what is around it, where a crest begins and is whole.
_CLOSE, _AROUND, _CREST = 0.5, 2.5, (0.08, 0.2)
# Upright lines come of level compression: how large it is, of the most between the brows, where a
# crest begins and is whole.
_PRESSED = (0.35, 0.8)
# Of what moves a place more, what moves it less, by one brow and by the other: where it begins to
# lie between the brows, and does so wholly.
_BETWEEN = (0.05, 0.2)


class Frown:
    """Collects the expressions of one mesh that draw down its brows."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._sides: dict[str, FloatArray] = {}

    def add(self, name: str, positions: NDArray[np.float32]) -> None:
        """Add one expression; it counts if its name tells which brow it draws down."""
        side = frowning_side(name)
        if side is not None:
            offsets = positions.astype(np.float64) - self._mesh.positions
            self._sides[side] = self._sides.get(side, 0.0) + offsets

    @property
    def positions(self) -> NDArray[np.float32] | None:
        """(V, 3) both brows drawn down; None where an expression of one of them is missing."""
        if not self._sides.keys() >= {LEFT, RIGHT}:
            return None
        both = self._mesh.positions + self._sides[LEFT] + self._sides[RIGHT]
        return both.astype(np.float32)

    def crests(self, surface: Diffusion, folds: FloatArray) -> NDArray[np.float32]:
        """(V,) how far vertices lie on a crest of level compression between the brows, 0 to 1.

        folds: (F, 6) squared log compression of `positions` in space, of the triangles.
        """
        between = ramp(self._evenness(), *_BETWEEN)
        close, around = (_level(surface, folds, share) for share in (_CLOSE, _AROUND))
        most = float((close * (between >= 1.0)).max())
        if most == 0.0:
            return np.zeros(len(between), np.float32)
        crest = ramp(close / np.maximum(around, 1e-12) - 1.0, *_CREST)
        found = between * crest * ramp(close / most, *_PRESSED)
        return found.astype(np.float32)

    def _evenness(self) -> FloatArray:
        """(V,) from 0 to 1: what the brow of one side moves, of what the other moves."""
        left, right = (np.linalg.norm(self._sides[side], axis=1) for side in (LEFT, RIGHT))
        larger = np.maximum(left, right)
        still = max(1e-6 * float(larger.max()), 1e-30)
        less = np.where(larger > still, np.minimum(left, right), 0.0)
        found: FloatArray = less / np.maximum(larger, still)
        return found


def _level(surface: Diffusion, folds: FloatArray, share: float) -> FloatArray:
    """(V,) root mean square log compression along the level direction, smoothed."""
    tensor = surface.narrower(share).of_triangles(folds)
    level = np.cross(_UP, surface.normals)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-30)
    found: FloatArray = np.sqrt(np.maximum(form(tensor, level, level), 0.0))
    return found
