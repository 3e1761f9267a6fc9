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

from rhytid.exports.textures.frame_map import Facts, FrameMap
from rhytid.exports.textures.tangents import Posed
from rhytid.exports.textures.writers import write_png

_WHITE = 65535


@dataclass(frozen=True, eq=False)
class NormalChart:
    """What of a UDIM does not change with the frame.

    triangles (R, R): of each texel, row 0 at the top; any where none is under its centre.  codes
    (R, R): which neighbours a difference may use, and whether a triangle is under the centre, as
    `neighbour_codes` has them.  uv_edges (F, 3, 2): of triangles, as `local_edges` has them.
    """

    triangles: NDArray[np.int32]
    codes: NDArray[np.uint8]
    uv_edges: NDArray[np.float64]

    def records(self, posed: Posed) -> NDArray[np.float32]:
        """(F, RECORD) what the kernel has of the triangles of a frame, in its order."""
        side, count = len(self.codes), len(self.uv_edges)
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
        du, lean, dv = posed.scale.T
        flat = (du <= 0.0) | (dv <= 0.0)
        per_du, per_dv = (np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, one)) for one in (du, dv))
        found = (
            start, shares, gains, posed.normals.reshape(count, 9), posed.tangents.reshape(count, 9),
            posed.along, np.stack([per_du, lean, per_dv, posed.signs], axis=1),
        )  # fmt: skip
        return np.concatenate(found, axis=1).astype(np.float32)


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
