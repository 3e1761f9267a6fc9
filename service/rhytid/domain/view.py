"""Which tiles of a face a camera sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress, TileGrid, udim_origin
from rhytid.errors import LimitError

# Texels that what is drawn reaches beyond a triangle: maps are read with filters.
_MARGIN = 2.0
# Of triangles and tiles that meet, in one UDIM: what takes half a GiB while they are found.
MOST_PAIRS = 1 << 23
_NONE = np.empty(0, np.int64)


class ViewedTiles:
    """Finds the tiles of one level of a mesh that a camera sees.

    A tile is seen where a triangle that has texels in it faces the camera and is not wholly outside
    of one side of the frustum. Triangles that others hide count as seen. Raises LimitError where
    triangles meet more tiles than are counted.
    """

    def __init__(self, mesh: Mesh, udims: tuple[int, ...], grid: TileGrid, level: int) -> None:
        self._faces = mesh.faces
        self._udims, self._level, self._side = udims, level, grid.count(level)
        uv = mesh.triangle_uv()
        margin = _MARGIN / grid.side(level)
        low, high = uv.min(axis=1) - margin, uv.max(axis=1) + margin
        found = [self._met(low, high, place) for place in range(len(udims))]
        self._triangles = np.concatenate([triangles for triangles, _ in found] or [_NONE])
        # Tiles as numbers, UDIM by UDIM and row by row; for each triangle the place of its tile.
        tiles = np.concatenate([tiles for _, tiles in found] or [_NONE])
        self._numbers, self._tiles = np.unique(tiles, return_inverse=True)

    def _met(
        self, low: NDArray[np.float64], high: NDArray[np.float64], place: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Triangles and the tiles of one UDIM that their boxes meet, a pair for each tile."""
        side = self._side
        first, last = _covered(low, high, self._udims[place], side)
        triangles = np.flatnonzero(((first < side) & (last >= 0)).all(axis=1))
        first = np.maximum(first[triangles], 0)
        rows, columns = (np.minimum(last[triangles], side - 1) - first + 1).T
        each = rows * columns
        pairs = int(each.sum())
        if pairs > MOST_PAIRS:
            raise LimitError(
                f"triangles in UDIM {self._udims[place]} meet {pairs} tiles of level "
                f"{self._level}, counted for each triangle: at most {MOST_PAIRS}; ask for a "
                "coarser level"
            )
        one = np.repeat(np.arange(len(each)), each)
        within = np.arange(pairs) - np.repeat(np.cumsum(each) - each, each)
        row = first[one, 0] + within // columns[one]
        column = first[one, 1] + within % columns[one]
        return triangles[one], (place * side + row) * side + column

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays."""
        arrays = (self._triangles, self._tiles, self._numbers, self._faces)
        return sum(array.nbytes for array in arrays)

    def seen(
        self,
        positions: NDArray[np.floating],
        camera: NDArray[np.float64],
        *,
        two_sided: bool = False,
    ) -> list[TileAddress]:
        """Addresses of the tiles that are seen, the largest in the picture first.

        positions: (V, 3) of the frame.  camera: (4, 4) projection times view; it maps a column
        (x, y, z, 1) to clip coordinates, where the frustum is -w ≤ x ≤ w, -w ≤ y ≤ w, z ≤ w and
        w > 0.  two_sided: triangles that turn their back to the camera count, too.
        """
        clip = positions.astype(np.float64) @ camera[:, :3].T + camera[:, 3]
        corners = clip[self._faces]
        area = _area_in_picture(corners, two_sided)
        shown = area[self._triangles]
        seen = np.bincount(self._tiles, shown > 0.0, len(self._numbers))
        size = np.bincount(self._tiles, shown, len(self._numbers))
        order = np.argsort(-size, kind="stable")
        return [self._address(number) for number in self._numbers[order[seen[order] > 0]].tolist()]

    def _address(self, number: int) -> TileAddress:
        row, column = divmod(number, self._side)
        place, row = divmod(row, self._side)
        return TileAddress(self._udims[place], self._level, row, column)


def _covered(
    low: NDArray[np.float64], high: NDArray[np.float64], udim: int, side: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(F, 2) first and last row and column of tiles that the box of each triangle meets."""
    u, v = udim_origin(udim)
    columns = np.stack([low[:, 0] - u, high[:, 0] - u], axis=1) * side
    # Row 0 is at the top, v points up.
    rows = side - np.stack([high[:, 1] - v, low[:, 1] - v], axis=1) * side
    both = np.floor(np.stack([rows, columns], axis=-1)).astype(np.int64)
    return both[:, 0], both[:, 1]


def _area_in_picture(corners: NDArray[np.float64], two_sided: bool) -> NDArray[np.float64]:
    """(F,) of triangles in clip coordinates (F, 3, 4): area in the picture, clipped to its size, of
    those that face the camera, counter-clockwise, or do not either; 0 of the others, and of those
    outside."""
    x, y, z, w = np.moveaxis(corners, -1, 0)
    outside = np.zeros(len(corners), bool)
    for beyond in (x > w, x < -w, y > w, y < -w, z > w):
        outside |= beyond.all(axis=1)
    outside |= (w <= 0.0).all(axis=1)
    # The homogeneous determinant has the sign of the facing, for what is partly behind, too.
    facing = (
        x[:, 0] * (y[:, 1] * w[:, 2] - y[:, 2] * w[:, 1])
        + x[:, 1] * (y[:, 2] * w[:, 0] - y[:, 0] * w[:, 2])
        + x[:, 2] * (y[:, 0] * w[:, 1] - y[:, 1] * w[:, 0])
    )
    hidden = facing == 0.0 if two_sided else ~(facing > 0.0)
    safe = np.where(w > 0.0, w, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        flat = np.stack([np.clip(x / safe, -1, 1), np.clip(y / safe, -1, 1)], axis=-1)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    area[(w <= 0.0).any(axis=1)] = 4.0  # reaches behind the camera: the whole picture
    # What is seen edge-on or clipped to a point still counts.
    return np.where(outside | hidden, 0.0, np.maximum(area, 1e-12))
