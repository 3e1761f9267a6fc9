"""Which neighbours of a texel its slope may use, for `pipeline/slopes.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import islands_of, local_edges, texels_inside
from rhytid.pipeline.slopes import ABOVE, BELOW, INSIDE, LEFT, RIGHT

# Rows that are worked on at once.
_ROWS = 512


def neighbour_codes(mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(R, R) codes of the texels of a UDIM, row 0 at the top: whether the centre lies in a
    triangle, and which neighbours count. Those of another island do not; of the same one, those
    outside of its triangles count where there is no other, as for normal maps.

    triangles: (R, R) the triangle of each texel, padding included; the number of triangles for
    none.
    """
    shown = triangles < len(mesh.faces)
    inside = texels_inside(np.where(shown, triangles, 0), local_edges(mesh, udim)) & shown
    if not inside.any():
        inside = shown
    island = np.append(islands_of(mesh), -1).astype(np.int32)
    side = len(triangles)
    out = np.zeros((side, side), np.uint8)
    for start in range(0, side, _ROWS):
        rows = np.arange(start - 1, min(start + _ROWS, side) + 1)
        near, held = rows.clip(0, side - 1), (rows >= 0) & (rows < side)
        here = np.where(held[:, None], island[triangles[near]], -1)
        out[start : start + _ROWS] = _codes(here, inside[near])
    return out


def _codes(island: NDArray[np.int32], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(h, w) codes of the rows between the first and the last of (h + 2, w)."""
    island = np.pad(island, ((0, 0), (1, 1)), constant_values=-1)
    inside = np.pad(inside, ((0, 0), (1, 1)))
    middle = island[1:-1, 1:-1]
    code: NDArray[np.uint8] = inside[1:-1, 1:-1] * np.uint8(INSIDE)
    pairs = (
        (RIGHT, np.s_[1:-1, 2:], LEFT, np.s_[1:-1, :-2]),
        (ABOVE, np.s_[:-2, 1:-1], BELOW, np.s_[2:, 1:-1]),
    )
    for one, at_one, other, at_other in pairs:
        same = [(island[at] == middle) & (middle >= 0) for at in (at_one, at_other)]
        good = [part & inside[at] for part, at in zip(same, (at_one, at_other), strict=True)]
        any_good = good[0] | good[1]
        for bit, mine, best in zip((one, other), same, good, strict=True):
            code |= np.where(any_good, best, mine) * np.uint8(bit)
    return code
