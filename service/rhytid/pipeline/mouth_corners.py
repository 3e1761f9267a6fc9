"""Where an open jaw presses the skin around the corners of the mouth, and which way.

An open jaw carries the lower lip away, and leaves the upper one: a corner of the mouth lies between
both. Below and beside it skin is drawn out along the way from one lip to the other and pressed
across that, so that its lines leave the corner as a fan. Over all expressions this is lost: a smile
folds the same skin in arcs around the corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.blendshapes import opens_jaw
from rhytid.domain.expressions import COLUMNS, ROWS
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.diffusion import Diffusion
from rhytid.pipeline.region_masks import ramp

FloatArray = NDArray[np.float64]
# Of what an open jaw moves most of the lips: where a place of the lips begins to lie between both,
# and does so wholly, from the upper one and from the lower one.
_FROM_UPPER, _FROM_LOWER = (0.2, 0.4), (0.8, 0.6)
# What is of the lips.
_LIP = 0.5
# What rays from a corner weigh beside the folds of the open jaw.
_RAYS = 0.8
# How far a corner spreads, and how finely directions around it are told apart, by these shares of
# the length of folds; and of what has spread, where fans begin and are whole.
_AROUND, _CLOSE, _NEAR = 3.0, 0.5, (0.07, 0.25)


class MouthCorners:
    """Collects the expressions of one mesh that open its jaw."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._offsets = np.zeros(mesh.positions.shape)
        self._folds: FloatArray = np.zeros((len(mesh.faces), 3))

    def add(self, name: str, positions: NDArray[np.float32], folds: NDArray[np.float32]) -> None:
        """Add one expression; it counts if its name says that it opens the jaw.  folds (F, 3): the
        result of `FoldStage.measure`."""
        if opens_jaw(name):
            self._offsets += positions.astype(np.float64) - self._mesh.positions
            self._folds += folds

    @property
    def folds(self) -> FloatArray | None:
        """(F, 3) of an open jaw, as `FoldStage.measure` has them; None where none opens."""
        return self._folds if self._offsets.any() else None

    def fans(
        self, surface: Diffusion, folds: FloatArray, lip: NDArray[np.float32] | None
    ) -> NDArray[np.float32] | None:
        """(V, 6) squared log compression of an open jaw in space, smoothed, as far as vertices lie
        beside a corner of the mouth; None where no corner is seen.

        folds: (F, 6) `folds` in space.  lip: (V,) how far vertices are of the lips; None where that
        is not known.
        """
        motion = np.linalg.norm(self._offsets, axis=1)
        down = float(motion @ self._offsets[:, 1]) < 0.0
        if lip is None or not down or not (lip > _LIP).any():
            return None
        share = motion / max(float(motion[lip > _LIP].max()), 1e-30)
        corner = lip * ramp(share, *_FROM_UPPER) * ramp(share, *_FROM_LOWER)
        spread = surface.narrower(_AROUND).of_vertices(corner[:, None])[:, 0]
        most = float(spread.max())
        if most <= 0.0:
            return None
        # Lips have creases of their own.
        near = ramp(spread / most, *_NEAR) * (1.0 - lip)
        across = _RAYS * folds[:, :3].sum(axis=1)[:, None] * _around(self._mesh, spread)
        found = surface.narrower(_CLOSE).of_triangles(folds + across) * (near**2)[:, None]
        fans: NDArray[np.float32] = found.astype(np.float32)
        return fans


def _around(mesh: Mesh, values: FloatArray) -> FloatArray:
    """(F, 6) squares q qᵀ of the unit tangents q of triangles across which values (V,) change most:
    those around a corner, for values that fall from there."""
    corners = mesh.positions.astype(np.float64)[mesh.faces]
    sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    # Across the gradient, times the double area.
    way = np.einsum("fc,fcx->fx", values[mesh.faces], sides)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    squares: FloatArray = way[:, ROWS] * way[:, COLUMNS]
    return squares
