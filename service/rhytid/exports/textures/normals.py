"""Normal maps: what of the mesh they need, and their files.

The normal of a surface P + h n is, to first order in h, along n - g, where g is the gradient of h
on the surface: g . dP/du = dh/du, g . dP/dv = dh/dv. A shader that reads the map computes
x T + y B + z N, and B = sign (N x T), of N and T that are interpolated and not made unit vectors
again, as MikkTSpace asks for; (x, y, z) is what makes this parallel to n - g. The device draws it
(`pipeline/normals.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import Facts, FrameMap, check_shown, local_edges
from rhytid.exports.textures.tangents import Posed
from rhytid.exports.textures.writers import write_png

_WHITE = 65535


@dataclass(frozen=True, eq=False)
class NormalChart:
    """What of a UDIM does not change with the frame.

    triangles (R, R): of each texel, row 0 at the top, its place in `shown`; any where none is under
    its centre.  codes (R, R): which neighbours a difference may use, and whether a triangle is
    under the centre, as `neighbour_codes` has them.  shown (K,): the triangles of the UDIM in
    ascending order.  uv_edges (K, 3, 2): of these, as `local_edges` has them.
    """

    triangles: NDArray[np.int32]
    codes: NDArray[np.uint8]
    shown: NDArray[np.int64]
    uv_edges: NDArray[np.float64]

    @classmethod
    def of(
        cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32], codes: NDArray[np.uint8]
    ) -> NormalChart:
        """The chart of a UDIM.

        triangles: (R, R) the triangle of each texel, padding included; the number of triangles for
        none.  codes: as here. Raises MeshError where no texel shows one.
        """
        check_shown(mesh, udim, triangles)
        here = np.zeros(len(mesh.faces) + 1, np.bool_)
        here[triangles] = True
        shown = np.flatnonzero(here[:-1])
        place = np.zeros(len(here), np.int32)
        place[shown] = np.arange(len(shown))
        return cls(place[triangles], codes, shown, local_edges(mesh, udim)[shown])

    def records(self, posed: Posed) -> NDArray[np.float32]:
        """(K, 33) what the kernel has of each of these triangles in a frame, in its order."""
        side, count, here = len(self.codes), len(self.shown), self.shown
        first, after, before = self.uv_edges.swapaxes(0, 1)
        # Columns go right, rows down; the centre of texel 0 is half a texel from the border.
        corner = np.stack([first[:, 0] * side, (1.0 - first[:, 1]) * side], axis=1) - 0.5
        start = np.floor(corner)
        (a, b), (c, d) = (edge.T * side for edge in (after, before))
        area = a * d - b * c
        per_area = np.divide(1.0, area, out=np.zeros(count), where=area != 0.0)
        gains = np.stack([d, -b, c, -a], axis=1) * per_area[:, None]
        back = start - corner
        shares = back[:, :1] * gains[:, :2] + back[:, 1:] * gains[:, 2:]
        du, lean, dv = posed.scale[here].T
        flat = (du <= 0.0) | (dv <= 0.0)
        per_du, per_dv = (np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, one)) for one in (du, dv))
        vectors = (posed.normals[here].reshape(count, 9), posed.tangents[here].reshape(count, 9))
        turned = np.stack([per_du, lean, per_dv, posed.signs[here]], axis=1)
        parts = (start, shares, gains, *vectors, posed.along[here], turned)
        return np.concatenate([part.astype(np.float32) for part in parts], axis=1)


def normal_gl_facts(map: FrameMap) -> Facts:
    """Facts of normal-gl: normals are 2 value - 1, green along v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "up"}


def normal_dx_facts(map: FrameMap) -> Facts:
    """Facts of normal-dx: normals are 2 value - 1, green against v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "down"}


def write_normals(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write normals as RGB PNG of 16 bits: in the padding those of the nearest texel inside, beyond
    it (0, 0, 1)."""
    codes = map.normals(-1 if facts["green"] == "down" else 1)
    map.padding().fill(codes)
    ends = (codes.min() / _WHITE * 2.0 - 1.0, codes.max() / _WHITE * 2.0 - 1.0)
    return write_png(path, codes, map, facts, ends)
