"""UDIM tiles, levels and the addresses of displacement tiles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import UV_LIMIT, Mesh, boxes, in_parts
from rhytid.errors import NotFoundError, QueryError

# UV units that a triangle must reach into a UDIM, unless it is as small itself: coordinates that
# were float32 once lie this far beyond a border that they mean.
BORDER_SLACK = 1e-6


@dataclass(frozen=True, order=True)
class TileAddress:
    """One tile of a displacement map: `udim/level/row/column`, row 0 at the top."""

    udim: int
    level: int
    row: int
    column: int

    def __str__(self) -> str:
        return f"{self.udim}/{self.level}/{self.row}/{self.column}"

    @classmethod
    def parse(cls, text: str) -> TileAddress:
        """Read `udim/level/row/column`; raises QueryError."""
        parts = text.split("/")
        if len(parts) != 4 or not all(p.isascii() and p.isdigit() and len(p) < 10 for p in parts):
            raise QueryError(f"tile {text!r}: expected udim/level/row/column, four whole numbers")
        return cls(*(int(p) for p in parts))


@dataclass(frozen=True)
class MapAddress:
    """A whole level of a UDIM: `udim/level`."""

    udim: int
    level: int

    def __str__(self) -> str:
        return f"{self.udim}/{self.level}"

    @property
    def first(self) -> TileAddress:
        """Its first tile."""
        return TileAddress(self.udim, self.level, 0, 0)


@dataclass(frozen=True)
class TileGrid:
    """How a map of `resolution`² texels is cut into levels and tiles of `tile_size`² texels."""

    resolution: int
    tile_size: int

    @property
    def levels(self) -> int:
        """Number of levels, down to one texel."""
        return int(math.log2(self.resolution)) + 1

    def side(self, level: int) -> int:
        """Texels per side of the map at a level."""
        return self.resolution >> level

    def texels(self, level: int) -> int:
        """Texels per side of a tile at a level: a level smaller than a tile is one smaller tile."""
        return min(self.tile_size, self.side(level))

    def side_of(self, place: TileAddress | MapAddress) -> int:
        """Texels per side of a tile or of a whole level."""
        level = place.level
        return self.texels(level) if isinstance(place, TileAddress) else self.side(level)

    def first_texel(self, address: TileAddress) -> tuple[int, int]:
        """Row and column of a tile's first texel, in its level."""
        texels = self.texels(address.level)
        return address.row * texels, address.column * texels

    def count(self, level: int) -> int:
        """Tiles per side at a level."""
        return self.side(level) // self.texels(level)

    def addresses(self, udim: int, level: int) -> list[TileAddress]:
        """Every tile of one level, row by row."""
        n = range(self.count(level))
        return [TileAddress(udim, level, row, column) for row in n for column in n]

    def check(self, address: TileAddress) -> None:
        """Raise NotFoundError where the level, row or column does not exist."""
        if not 0 <= address.level < self.levels:
            raise NotFoundError(f"level {address.level}: levels go from 0 to {self.levels - 1}")
        last = self.count(address.level) - 1
        for name, index in (("row", address.row), ("column", address.column)):
            if not 0 <= index <= last:
                raise NotFoundError(f"{name} {index} at level {address.level}: 0 to {last}")


def udim_origin(udim: int) -> tuple[int, int]:
    """(u, v) of the lower left corner of a UDIM."""
    return (udim - 1001) % 10, (udim - 1001) // 10


def udims_at(uv: NDArray[np.floating]) -> NDArray[np.int64]:
    """(N,) the UDIM that each place (N, 2) lies in, of those with u in [0, 10) and v >= 0."""
    cell = np.floor(uv).astype(np.int64)
    found: NDArray[np.int64] = 1001 + cell[:, 0] + 10 * cell[:, 1]
    return found


def mesh_udims(mesh: Mesh) -> tuple[int, ...]:
    """The UDIMs that triangles with area in UV overlap, ascending.

    UV outside of u in [0, 10) and v >= 0 is ignored. A triangle that touches a border, or passes it
    by no more than 1e-6, does not overlap what lies beyond.
    """
    corners = mesh.triangle_uv()[mesh.triangles_with_uv()]
    low, high = boxes(corners)
    first = np.clip(np.floor(low.min(axis=0, initial=UV_LIMIT)), 0, None).astype(int)
    end = np.minimum(np.ceil(high.max(axis=0, initial=0.0)), (10, UV_LIMIT)).astype(int)
    squares = [(u, v) for v in range(first[1], end[1]) for u in range(first[0], end[0])]
    found = [one for one in squares if _reached(corners, low, high, np.array(one))]
    return tuple(1001 + u + 10 * v for u, v in found)


def _reached(
    corners: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    origin: NDArray[np.integer],
) -> bool:
    """Whether any triangle with such boxes overlaps the unit square at `origin`."""
    inside = (low > origin + 2 * BORDER_SLACK) & (high < origin + (1 - 2 * BORDER_SLACK))
    if inside.all(axis=1).any():  # of most squares, and soon seen
        return True
    near = (high > origin).all(axis=1) & (low < origin + 1).all(axis=1)
    return _overlap_square(corners, np.flatnonzero(near), origin)


def _overlap_square(
    corners: NDArray[np.float64], near: NDArray[np.intp], origin: NDArray[np.integer]
) -> bool:
    """Whether any of those triangles overlaps the unit square at `origin`."""
    parts = (corners[near[part]] for part in in_parts(len(near)))
    return any(_overlaps_square(part, origin) for part in parts)


def _overlaps_square(corners: NDArray[np.float64], origin: NDArray[np.integer]) -> bool:
    """Whether any triangle (K, 3, 2) overlaps the unit square at `origin`: no axis parts them, of
    the sides of the square and the normals of the edges."""
    centred = corners - (origin + 0.5)
    extent = np.ptp(corners, axis=1).max(axis=-1, keepdims=True)
    half = 0.5 - np.minimum(BORDER_SLACK, 0.25 * extent)
    edges = np.roll(centred, -1, axis=1) - centred
    normals = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
    sides = np.broadcast_to(np.eye(2), (len(corners), 2, 2))
    axes = np.concatenate([sides, normals], axis=1)
    along = np.einsum("kac,kpc->kap", axes, centred)
    reach = half * np.abs(axes).sum(axis=-1)
    return bool(((along.min(axis=-1) < reach) & (along.max(axis=-1) > -reach)).all(axis=1).any())


def triangles_inside(mesh: Mesh, udim: int) -> NDArray[np.bool_]:
    """(F,) whether the middle of a triangle's corners lies in a UDIM."""
    cells = np.floor(mesh.triangle_uv().mean(axis=1))
    inside: NDArray[np.bool_] = (cells == udim_origin(udim)).all(axis=1)
    return inside


def busiest_udim(mesh: Mesh) -> int:
    """The UDIM with the most triangles, the lowest on ties."""
    return max(mesh_udims(mesh), key=lambda udim: int(triangles_inside(mesh, udim).sum()))


def texel_centres(start: int, count: int, resolution: int) -> NDArray[np.float64]:
    """Centres of `count` columns from `start` on, in UV units local to the UDIM: (i + ½)/R."""
    return (np.arange(start, start + count, dtype=np.float64) + 0.5) / resolution
