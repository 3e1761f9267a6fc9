"""Displacement of texels next to the islands of the UV layout, for filters that read across their
borders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rhytid.domain.mesh import Mesh
from rhytid.textures.chart import local_edges, texels_inside

# Rows that are searched at once, beside the margin on both sides.
_ROWS = 256


@dataclass(frozen=True, eq=False)
class Padding:
    """Which texels of a map take the displacement of which others: found once per asset.

    texels, sources: (K,) numbers, row by row. They are few, along the borders, so that an asset of
    many UDIMs can keep them all.
    """

    texels: NDArray[np.int32]
    sources: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32], reach: int) -> Padding:
        """From what the service finds: the triangle (R, R) of each texel, that of the nearest one
        within `reach` texels of an island, the number of triangles for none."""
        shown = triangles < len(mesh.faces)
        inside = texels_inside(np.where(shown, triangles, 0), local_edges(mesh, udim)) & shown
        found = list(_nearest(shown & ~inside, inside, reach + 1))
        texels = [texel for texel, _ in found] or [np.zeros(0, np.int32)]
        sources = [source for _, source in found] or [np.zeros(0, np.int32)]
        return cls(np.concatenate(texels), np.concatenate(sources))

    def padded(self, heights: NDArray[np.float32]) -> NDArray[np.float32]:
        """A copy of a map (R, R) in which `texels` have what `sources` have."""
        out: NDArray[np.float32] = heights.copy()
        out.reshape(-1)[self.texels] = heights.reshape(-1)[self.sources]
        return out


def _nearest(
    wanted: NDArray[np.bool_], inside: NDArray[np.bool_], reach: int
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Numbers of texels that are wanted, and of the nearest ones inside, some rows at a time: a
    search of the whole map takes 12 bytes a texel. Where none is within reach of the rows, the
    texel is left out."""
    side = len(wanted)
    for start in range(0, side, _ROWS):
        row, column = np.nonzero(wanted[start : start + _ROWS])
        first = max(start - reach, 0)
        near = inside[first : start + _ROWS + reach]
        if not len(row) or not near.any():
            continue
        rows, columns = ndimage.distance_transform_edt(
            ~near, return_distances=False, return_indices=True
        )
        here = row + (start - first), column
        source = (rows[here].astype(np.int64) + first) * side + columns[here]
        yield ((row + start) * side + column).astype(np.int32), source.astype(np.int32)
