"""Where a frown presses skin most: two upright crests left and right of the middle of the brows.

Expressions move one brow each, and a frown moves both. Between the brows both press the same skin,
so that a mean over expressions, each by itself, has its crests farther out than a frown has. The
plane between them is where either brow moves skin as far. Where one expression moves both, it is
the upright one through the middle of what moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.blendshapes import BOTH, LEFT, RIGHT, frowning_side
from rhytid.domain.expressions import form
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.diffusion import Diffusion, triangle_areas
from rhytid.pipeline.region_masks import ramp

FloatArray = NDArray[np.float64]
# The vertical axis of a mesh; its cross product with a normal is level.
_UP = np.array([0.0, 1.0, 0.0])
# A crest stands out of what is around it: both smoothed, by these shares of the length of folds;
# how far, of what is around it, where a crest begins and is whole.
_CLOSE, _AROUND, _CREST = 0.5, 2.5, (0.05, 0.2)
# Upright lines come of level compression: how large it is, of the most between the brows, where a
# crest begins and is whole.
_PRESSED = (0.25, 0.7)
# Of what moves a place more, what moves it less, by one brow and by the other: where it begins to
# lie between the brows, and does so wholly.
_BETWEEN = (0.05, 0.2)
# The same where one shape moves both: how far from the plane, of the mean distance of what moves.
_BESIDE = (0.42, 0.3)
# How high a crest is, of its highest place, where its line is faint and where it is whole.
_HEIGHT = (0.0, 0.85)


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
        if self._sides.keys() >= {LEFT, RIGHT}:
            moved = self._sides[LEFT] + self._sides[RIGHT]
        elif BOTH in self._sides:
            moved = self._sides[BOTH]
        else:
            return None
        return (self._mesh.positions + moved).astype(np.float32)

    def crests(self, surface: Diffusion, folds: FloatArray) -> NDArray[np.float32]:
        """(V,) how far vertices lie on a crest of level compression between the brows: from 0 to 1
        on that of the left brow, from 0 to -1 on that of the right one.

        folds: (F, 6) squared log compression of `positions` in space, of the triangles.
        """
        beside, between = self._sided(surface.normals)
        close, around = (_level(surface, folds, share) for share in (_CLOSE, _AROUND))
        most = float((close * (between >= 1.0)).max())
        if most == 0.0:
            return np.zeros(len(between), np.float32)
        crest = close / np.maximum(around, 1e-12) - 1.0
        pressed = between * ramp(close / most, *_PRESSED)
        found = np.zeros(len(between))
        for side in (1.0, -1.0):
            height = pressed * np.maximum(crest, 0.0) * (side * beside > 0.0)
            highest = ramp(height / max(float(height.max()), 1e-12), *_HEIGHT)
            found += side * highest * ramp(crest, *_CREST) * pressed * (side * beside > 0.0)
        return found.astype(np.float32)

    def _sided(self, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(V,) above 0 left of the plane between the brows and below 0 right of it, and (V,) from 0
        to 1 how far vertices lie between them."""
        if not self._sides.keys() >= {LEFT, RIGHT}:
            return self._about_middle(normals)
        left, right = (np.linalg.norm(self._sides[side], axis=1) for side in (LEFT, RIGHT))
        larger = np.maximum(left, right)
        still = max(1e-6 * float(larger.max()), 1e-30)
        less = np.where(larger > still, np.minimum(left, right), 0.0)
        return left - right, ramp(less / np.maximum(larger, still), *_BETWEEN)

    def _about_middle(self, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same of a shape that moves both brows."""
        places, moved = self._mesh.positions.astype(np.float64), self._sides[BOTH]
        corners = places[self._mesh.faces]
        share = triangle_areas(corners) * (moved[self._mesh.faces].mean(axis=1) ** 2).sum(axis=1)
        share /= max(float(share.sum()), 1e-300)
        across = np.cross(_UP, share @ normals[self._mesh.faces].mean(axis=1))
        across /= max(float(np.linalg.norm(across)), 1e-30)
        beside = corners.mean(axis=1) @ across
        middle = share @ beside
        far = max(float(share @ np.abs(beside - middle)), 1e-30)
        beside = places @ across - middle
        return beside, ramp(-np.abs(beside) / far, *(-limit for limit in _BESIDE))


def _level(surface: Diffusion, folds: FloatArray, share: float) -> FloatArray:
    """(V,) root mean square log compression along the level direction, smoothed."""
    tensor = surface.narrower(share).of_triangles(folds)
    level = np.cross(_UP, surface.normals)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-30)
    found: FloatArray = np.sqrt(np.maximum(form(tensor, level, level), 0.0))
    return found
