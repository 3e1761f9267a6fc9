"""What a relief is on the surface: sampled by area in space, and along both sides of UV seams."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import bilinear
from rhytid.domain.scan import Codes, Scan, full_range
from rhytid.domain.tiles import udim_origin, udims_at

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
# Places on the surface, and on each seam edge.
_SAMPLES, _ON_AN_EDGE = 1 << 16, 4
# Fractions of the additive recurrence that fills a triangle evenly (R2, by the plastic number).
_R2 = (0.7548776662466927, 0.5698402909980532)
# Most seam edges that are looked at; of longer seams every so many.
_MOST_EDGES = 1 << 15


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Places that are evenly spread on the surface.

    triangle (N,), uv (N, 2) with the UDIM's offset, udim (N,).  across (N, 2, 2): what a step of
    one mesh unit along each of two directions at right angles is in UV.
    """

    triangle: IntArray
    uv: FloatArray
    udim: IntArray
    across: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> SurfaceSamples:
        """Places on the usable triangles of a mesh; always the same."""
        used = np.flatnonzero(mesh.usable_triangles())
        a, b, c = np.moveaxis(mesh.positions[mesh.faces[used]].astype(np.float64), 1, 0)
        ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * ends[-1]
        chosen = np.searchsorted(ends, share)
        x, y = (np.mod((np.arange(_SAMPLES) + 1) * step, 1.0) for step in _R2)
        beyond = x + y > 1.0
        x, y = np.where(beyond, 1.0 - x, x), np.where(beyond, 1.0 - y, y)
        corner = mesh.triangle_uv()[used[chosen]]
        edges = corner[:, 1:] - corner[:, :1]
        uv = corner[:, 0] + x[:, None] * edges[:, 0] + y[:, None] * edges[:, 1]
        across = _across(a[chosen], b[chosen], c[chosen], edges)
        return cls(used[chosen], uv, udims_at(uv), across)

    def heights(self, scan: Scan, udim: int) -> tuple[FloatArray, FloatArray]:
        """(K,) heights at the places of a UDIM, mesh units, and (K,) how steep the relief is there:
        its gradient along the surface, over the length of a texel."""
        here = self.udim == udim
        local, across = self.uv[here] - udim_origin(udim), self.across[here]
        side = np.sqrt(np.abs(np.linalg.det(across))) * max(scan.maps[udim].shape)
        step = 1.0 / np.where(side > 0.0, side, 1.0)  # a texel on the surface
        found = height_at(scan, udim, local)
        along = [
            height_at(scan, udim, local + step[:, None] * across[:, :, axis]) - found
            for axis in (0, 1)
        ]
        return found, np.hypot(*along) / step


def height_at(scan: Scan, udim: int, local: FloatArray) -> FloatArray:
    """(P,) heights of a scan at places (P, 2) of a UDIM, mesh units, linear between texels."""
    total = np.zeros(len(local))
    channels = zip(scan.maps[udim].channels, scan.scales, scan.midlevels[udim], strict=True)
    for values, scale, midlevel in channels:
        total += scale * (bilinear(values, local, _values).astype(np.float64) - midlevel)
    return total


def _values(texels: Codes) -> NDArray[np.float32]:
    found: NDArray[np.float32] = texels.astype(np.float32) / np.float32(full_range(texels))
    return found


def _across(a: FloatArray, b: FloatArray, c: FloatArray, edges: FloatArray) -> FloatArray:
    """(N, 2, 2) UV steps (rows) of unit steps along two directions (columns) of a triangle."""
    ab, ac = b - a, c - a
    length = np.linalg.norm(ab, axis=1)
    first = ab / length[:, None]
    along = np.sum(first * ac, axis=1)
    height = np.linalg.norm(ac - along[:, None] * first, axis=1)
    # Edges in the plane of the triangle are (length, 0) and (along, height).
    of_first = edges[:, 0] / length[:, None]
    of_second = (edges[:, 1] - along[:, None] * of_first) / height[:, None]
    return np.stack([of_first, of_second], axis=2)


@dataclass(frozen=True, eq=False)
class Seams:
    """Edges in space whose two sides lie apart in UV.

    uv (E, 2, 2, 2): of each edge both sides, of each side both ends, in the same order.  ends (E,
    2, 3): in space.  inward (E, 2, 2): of each side the way in UV to the middle of its triangle.
    """

    uv: FloatArray
    ends: FloatArray
    inward: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> Seams:
        """The seams of a mesh; edges of other than two triangles are left out."""
        _, place = np.unique(mesh.positions + np.float32(0), axis=0, return_inverse=True)
        corner = place.reshape(-1)[mesh.faces].astype(np.int64)
        uv = mesh.triangle_uv()
        both = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
        sides = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        turned = both[:, 0] > both[:, 1]
        both[turned], sides[turned] = both[turned, ::-1], sides[turned, ::-1]
        order = np.lexsort((both[:, 1], both[:, 0]))
        first = np.append(True, (np.diff(both[order], axis=0) != 0).any(axis=1))
        start = np.flatnonzero(first)
        twice = start[np.diff(np.append(start, len(order))) == 2]
        pair = np.stack([order[twice], order[twice + 1]], axis=1)
        pair = pair[(sides[pair[:, 0]] != sides[pair[:, 1]]).any(axis=(1, 2))]
        pair = pair[:: max(-(-len(pair) // _MOST_EDGES), 1)]
        points = mesh.positions.astype(np.float64)[mesh.faces].reshape(-1, 3)
        here = np.stack([pair[:, 0], _next(pair[:, 0])], axis=1)
        here = np.where(turned[pair[:, :1]], here[:, ::-1], here)
        middle = uv.mean(axis=1)[pair // 3] - sides[pair].mean(axis=2)
        return cls(sides[pair], points[here], middle)

    def __len__(self) -> int:
        return len(self.uv)

    @cached_property
    def places(self) -> tuple[FloatArray, FloatArray]:
        """(E, S, 2, 2) UV of places on both sides of each edge, and (E, S, 3) these in space."""
        share = (np.arange(_ON_AN_EDGE) + 0.5) / _ON_AN_EDGE
        uv = (
            self.uv[:, None, :, 0]
            + share[None, :, None, None] * np.diff(self.uv, axis=2)[:, None, :, 0]
        )
        space = self.ends[:, None, 0] + share[None, :, None] * np.diff(self.ends, axis=1)
        return uv, space

    def heights(self, scan: Scan) -> FloatArray:
        """(E, S, 2) heights on both sides of each place, mesh units; nan where there is no map."""
        uv, _ = self.places
        # A hair inside, so that what lies on the border of a UDIM is of its own.
        inside = uv + 1e-6 * self.inward[:, None]
        flat = inside.reshape(-1, 2)
        udim = udims_at(flat)
        found = np.full(len(flat), np.nan)
        for one in scan.maps:
            here = udim == one
            found[here] = height_at(scan, one, flat[here] - udim_origin(one))
        return found.reshape(uv.shape[:3])


def _next(corner: IntArray) -> IntArray:
    """The next corner of the same triangle, of corners as one row."""
    return corner - corner % 3 + (corner + 1) % 3
