"""How much the UV change their metric beside places on seams: an affine copy of what is wider than
the triangles there cannot be as wide along all of the seam.

Found from the mesh alone, apart from the product.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

Floats = NDArray[np.float64]


class MetricChange:
    """The metrics of the triangles of a mesh, and which meet in UV."""

    def __init__(self, mesh: Mesh) -> None:
        self.corners = mesh.positions.astype(float)[mesh.faces]
        self.uv = mesh.triangle_uv()
        self.usable = mesh.usable_triangles()
        sides, uv_sides = ((a[:, 1:] - a[:, :1]).swapaxes(1, 2) for a in (self.corners, self.uv))
        jacobian = sides[self.usable] @ np.linalg.inv(uv_sides[self.usable])
        metric = jacobian.swapaxes(1, 2) @ jacobian
        self.root = np.zeros((len(self.uv), 2, 2))
        self.root[self.usable] = np.linalg.cholesky(metric).swapaxes(1, 2)
        self.meeting = self._meeting()

    def around(self, triangle: int, place: Floats, reach: float) -> float:
        """The largest ratio of a length in the triangle that holds a place to what the metric of
        another says of it, or the other way round, of triangles of its chart within `reach`."""
        seen, waiting, most = {triangle}, [triangle], 1.0
        own = np.linalg.inv(self.root[triangle])
        while waiting:
            for other in self.meeting[waiting.pop()] - seen:
                seen.add(other)
                if self.usable[other] and self._away(place, other) < reach:
                    waiting.append(other)
                    sizes = np.linalg.svd(self.root[other] @ own, compute_uv=False)
                    most = max(most, sizes[0], 1 / sizes[1])
        return most

    def _meeting(self) -> dict[int, set[int]]:
        """Of each triangle those that have a side in common with it, in space and in UV."""
        sides = defaultdict(list)
        ends = np.concatenate([self.corners, self.uv], axis=-1) + 0.0
        for t, corners in enumerate(ends):
            keys = [tuple(corner) for corner in corners]
            for i in range(3):
                sides[frozenset((keys[i], keys[i - 1]))].append(t)
        meeting = defaultdict(set)
        for pair in sides.values():
            for t in pair:
                meeting[t].update(pair)
        return meeting

    def _away(self, place: Floats, triangle: int) -> float:
        """How far a place (3,) is from a triangle."""
        a, b, c = self.corners[triangle]
        inside = np.linalg.lstsq(np.stack([b - a, c - a], 1), place - a, rcond=None)[0]
        if inside.min() >= 0 and inside.sum() <= 1:
            return float(np.linalg.norm(a + inside @ [b - a, c - a] - place))
        return min(_to_side(place, *side) for side in ((a, b), (b, c), (c, a)))


def _to_side(place: Floats, start: Floats, stop: Floats) -> float:
    along = stop - start
    share = np.clip((place - start) @ along / (along @ along), 0, 1)
    return float(np.linalg.norm(start + share * along - place))
