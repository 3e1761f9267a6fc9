"""What folds of a deformed mesh take of its log compression, for the shader's texture of stretch.

Part of a skin package of rhytid; needs numpy alone. `stretch.folds` of the manifest has the
numbers; where it is null folds take nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
# Of a squared ratio: of a triangle that is pressed to nothing.
_LEAST_SQUARE = 1e-12


class Folds:
    """The folds of a mesh, ready for any frame.

    positions: (V, 3) of the neutral, in the unit of the package.  faces: (F, 3).  rest: (F, 8) of
    triangles.bin.  numbers: `stretch.folds` of the manifest.
    """

    def __init__(
        self, positions: Array, faces: Array, rest: Array, numbers: Mapping[str, Any]
    ) -> None:
        neutral = np.asarray(positions, np.float64)
        self._faces, self._numbers = np.asarray(faces), numbers
        self._usable = np.asarray(rest)[:, 3] > 0
        # Vertices at one place in the neutral are one: those that are split at UV seams.
        place = np.unique(neutral + 0.0, axis=0, return_inverse=True)[1].reshape(-1)
        self._corners = place[self._faces]
        self._count = int(place.max()) + 1
        area = np.linalg.norm(self._crossed(neutral), axis=1) * self._usable
        self._weights = np.repeat(area, 3)
        sums = np.bincount(self._corners.reshape(-1), self._weights, self._count)
        self._sums = np.maximum(sums, 1e-300)
        one, along, high, _ = np.asarray(rest, np.float64)[:, :4].T
        # Of both edges to the axes of the frame of each neutral triangle.
        self._axes = np.stack([one, -along * high, 0 * one, high], axis=1).reshape(-1, 2, 2)
        self._before = self._forms(neutral)[1]

    def shares(self, positions: Array) -> NDArray[np.float32]:
        """(F,) the share that folds take of the compression of each triangle in a frame.

        positions: (V, 3) of the frame.
        """
        metric, form = self._forms(np.asarray(positions, np.float64))
        values, axes = np.linalg.eigh(metric)
        square = np.maximum(values, _LEAST_SQUARE)
        pressed = np.clip(-0.5 * np.log(square), 0, 1)
        bent = _along(form, axes) / square - _along(self._before, axes)
        most = self._numbers["most_bend"]
        b = (pressed * np.clip(self._numbers["length"] * bent, -most, most)).sum(1) * self._usable
        mean, of_squares = self._smoothed(np.stack([b, b * b], 1), self._numbers["rounds"]).T
        variance = of_squares - mean * mean - self._numbers["least"]
        share = self._numbers["most"] * (1 - (1 + np.maximum(variance, 0)) ** -0.25)
        found: NDArray[np.float32] = share[self._corners].mean(axis=1).astype(np.float32)
        return found

    def _forms(self, positions: Array) -> tuple[Array, Array]:
        """Both fundamental forms (F, 2, 2), along the axes of the frames of the triangles."""
        edges = self._along_axes(positions[self._faces])
        turns = self._along_axes(self._normals(positions)[self._corners])
        form = np.swapaxes(turns, 1, 2) @ edges
        return np.swapaxes(edges, 1, 2) @ edges, 0.5 * (form + np.swapaxes(form, 1, 2))

    def _along_axes(self, corners: Array) -> Array:
        """(F, 3, 2) how values (F, 3, 3) of the corners change along both axes."""
        both = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        found: Array = both @ self._axes
        return found

    def _normals(self, positions: Array) -> Array:
        crossed = np.repeat(self._crossed(positions) * self._usable[:, None], 3, axis=0)
        found = self._summed(crossed)
        found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)
        rounds = self._numbers["normal_rounds"]
        return self._smoothed(found[self._corners].mean(axis=1), rounds) if rounds else found

    def _smoothed(self, triangles: Array, rounds: int) -> Array:
        """Means over the triangles around each place, by area, `rounds` times."""
        for left in reversed(range(rounds)):
            weighted = np.repeat(triangles, 3, axis=0) * self._weights[:, None]
            places = self._summed(weighted) / self._sums[:, None]
            if left:
                triangles = places[self._corners].mean(axis=1)
        return places

    def _summed(self, corners: Array) -> Array:
        at = self._corners.reshape(-1)
        return np.stack([np.bincount(at, column, self._count) for column in corners.T], axis=1)

    def _crossed(self, positions: Array) -> Array:
        p = positions[self._faces]
        crossed: Array = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        return crossed


def _along(form: Array, axes: Array) -> Array:
    """(F, 2) a form along both axes, the columns of (F, 2, 2)."""
    found: Array = np.einsum("fia,fij,fja->fa", axes, form, axes)
    return found
