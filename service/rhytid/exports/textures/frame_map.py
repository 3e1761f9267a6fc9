"""One UDIM of one frame as the profiles draw it, and where its texels lie on the mesh.

`Chart` and `Padding` are found once per asset and are the same in every frame: the points of the
mesh under the texels, and which texels next to the islands of the UV layout take the displacement
of others, for filters that read across their borders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.errors import MeshError
from rhytid.exports.textures.square_sums import Sums, with_square_sums
from rhytid.exports.textures.tangents import Posed
from rhytid.formats.exr_encoder import Texels
from rhytid.formats.tile_header import TileHeader
from rhytid.support.cores import on_all_cores

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
T = TypeVar("T", bound=np.generic)
Facts = dict[str, str | int | float]
Sampled = Callable[[NDArray[np.int32], FloatArray], FloatArray]
# Texels that are worked on at once: some 40 doubles each.
_TEXELS = 1 << 18
# The square around a texel, as a share of the side of a map: some 4 mm on a face that fills it.
_AROUND = 1.0 / 64.0
# Tolerance of a barycentric weight: the device looks up with UV that are rounded to float32.
_ROUNDED = 1e-4
# Rows that a core pads at a time.
_ROWS = 256
# Texels a side of what is searched at once, beside the margin around it.
_BLOCK = 256
# The values are data, not colours: the attribute of OpenEXR, and in plain words.
_RAW: Facts = {"colour_space": "raw", "colorInteropID": "data"}


@dataclass(frozen=True, eq=False)
class FrameMap:
    """One UDIM of one frame. Values that take long to compute are functions, which compute them
    once.

    header: of the map.  depth: of a furrow of strength 1, mesh units.  heights: (R, R) float32
    displacement, mesh units, row 0 at the top.  halves: the same for files of half floats: float16
    where no other file needs float32, else what `heights` gives.  padding: of the texels next to
    islands.  chart: its texels on the mesh.  posed: the surface of the frame.  weights: (F, 3, 2)
    of corners, stretch and compression.  stretch: log stretch at vertices, as `vertex_stretch` has
    it.  blood: (1, ) of vertices, as `BloodFlow` has it.  lag: facts of how late it follows.
    slopes: of a level, moments (n, n, 5) of slopes and the share (n, n) of each texel that has
    skin.  normals: (R, R, 3) codes of (normal + 1) / 2, not padded, with green along v for 1 and
    against it for -1.
    """

    header: TileHeader
    depth: float
    heights: Callable[[], NDArray[np.float32]]
    halves: Callable[[], Texels]
    padding: Callable[[], Padding]
    chart: Callable[[], Chart]
    posed: Callable[[], Posed]
    weights: Callable[[], NDArray[np.float64]]
    stretch: Callable[[], VertexField]
    blood: Callable[[], VertexField]
    lag: Facts
    slopes: Callable[[int], tuple[NDArray[np.float32], NDArray[np.float32]]]
    normals: Callable[[int], NDArray[np.uint16]]

    def padded(self) -> NDArray[np.float32]:
        """The displacement; texels outside of the islands have that of the nearest texel inside."""
        return self.chart().padded(self.heights())


def attributes(header: TileHeader, facts: Facts, minimum: float, maximum: float) -> Facts:
    """The attributes that are written beside the texels.

    facts: of the profile, `scale` among them.  minimum, maximum: of the values that the texels
    stand for.
    """
    ends = {"minimum": float(minimum), "maximum": float(maximum)}
    return {**header.attributes(), **facts, **ends, **_RAW}


@dataclass(frozen=True, eq=False)
class VertexField:
    """Values (P, K) at the places of a mesh, smooth over seams, and the place (F, 3) of each
    corner of a triangle."""

    values: FloatArray
    places: IntArray

    def at(self, found: NDArray[np.int32], share: FloatArray) -> FloatArray:
        """(N, K) at points with barycentric weights (N, 3) in triangles `found` (N,)."""
        mean: FloatArray = np.einsum("kc,kcx->kx", share, self.values[self.places[found]])
        return mean


@dataclass(frozen=True, eq=False)
class Chart:
    """The triangles (R, R) of the texels of a UDIM, row 0 at the top.

    covered (R, R): which texels show a triangle, padding included; the others have that of the
    nearest one that does.  inside (R, R): which have their centre in their triangle.  nearest
    (R, R): the number of the nearest one inside, row by row.  uv_edges (F, 3, 2): first corner,
    local to the UDIM, and the two edges from it.
    """

    triangles: NDArray[np.int32]
    covered: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    nearest: NDArray[np.int32]
    uv_edges: FloatArray

    @classmethod
    def of(cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> Chart:
        """The chart of a UDIM.

        triangles: (R, R) the triangle of each texel, as the service finds it; the number of
        triangles stands for none. Raises MeshError where no texel shows one.
        """
        edges = local_edges(mesh, udim)
        covered = check_shown(mesh, udim, triangles)
        filled = triangles.reshape(-1)[nearest_known(covered)]
        inside = texels_inside(filled, edges) & covered
        # Triangles that all lie between the centres of texels.
        inside = inside if inside.any() else covered
        return cls(filled, covered, inside, nearest_known(inside), edges)

    def padded(self, values: NDArray[T]) -> NDArray[T]:
        """(R, R, …) values whose texels outside of the islands have the value of the nearest texel
        inside."""
        flat, out = values.reshape(-1, *values.shape[2:]), np.empty_like(values)

        def rows(start: int) -> None:
            part = slice(start, start + _ROWS)
            # Numbers are of texels that there are: to check them costs a copy.
            np.take(flat, self.nearest[part], axis=0, out=out[part], mode="clip")

        on_all_cores(rows, range(0, len(out), _ROWS))
        return out

    @property
    def around(self) -> int:
        """Texels a side of the square around a texel, an odd number: `_AROUND` of the map."""
        return max(round(_AROUND * len(self.inside)), 1) | 1

    @cached_property
    def inside_around(self) -> NDArray[np.float32]:
        """(R, R) how many texels of the square around each are inside, 0.5 where none is."""
        found = np.empty(self.inside.shape, np.float32)

        def note(sums: Sums) -> None:
            first, counts = sums
            found[first : first + len(counts)] = np.maximum(counts, 0.5)

        with_square_sums(self.inside.__getitem__, len(found), self.around, note)
        return found

    def corner_weights(self, rows: slice) -> FloatArray:
        """(K, 3) barycentric weights of the texels of some rows, in their triangles; outside of its
        triangle a texel has those of a point on its border."""
        where = np.ones(self.triangles[rows].shape, np.bool_)
        weights = _barycentric(self.triangles, self.uv_edges, rows, where).clip(0.0, None)
        scaled: FloatArray = weights / weights.sum(axis=1, keepdims=True)
        return scaled

    def sampled(self, width: int, value: Sampled) -> NDArray[np.float32]:
        """(R, R, width) float32 of what `value` gives for triangles (K,) and the weights (K, 3) of
        points in them.

        Beyond the padding a texel has the value of the nearest one within it, so that coarser
        levels do not fade towards the borders of islands.
        """
        side = len(self.triangles)
        out = np.zeros((side, side, width), np.float32)
        rows = max(_TEXELS // side, 1)
        for start in range(0, side, rows):
            part = slice(start, min(start + rows, side))
            found = self.triangles[part].reshape(-1)
            share = self.corner_weights(part)
            out[part] = value(found, share).reshape(-1, side, width)
        return out


@dataclass(frozen=True, eq=False)
class Padding:
    """Which texels of a map take the displacement of which others: found once per asset.

    texels, sources: (K,) numbers, row by row, `texels` in ascending order. They are few, along the
    borders, so that an asset of many UDIMs can keep them all.
    """

    texels: NDArray[np.int32]
    sources: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: Mesh, udim: int, triangles: NDArray[np.int32], reach: int) -> Padding:
        """The padding of a UDIM.

        triangles: (R, R) the triangle of each texel, or of the nearest one within `reach` texels of
        an island, as the service finds it; the number of triangles stands for none.
        """
        shown = triangles < len(mesh.faces)
        inside = texels_inside(np.where(shown, triangles, 0), local_edges(mesh, udim)) & shown
        return cls(*_nearest_inside(shown & ~inside, inside, reach + 1))

    def padded(self, heights: NDArray[np.float32]) -> NDArray[np.float32]:
        """A copy of a map (R, R) in which each of `texels` has the value of its source."""
        return self.rows(heights, 0, len(heights))

    def fill(self, values: NDArray[Any]) -> None:
        """Give each of `texels` of a map (R, R, …) the values of its source, in place."""
        texels, sources = (np.divmod(one, values.shape[1]) for one in (self.texels, self.sources))
        values[texels] = values[sources]

    def sources_of(self, texels: NDArray[np.int32]) -> NDArray[np.int32]:
        """Of some texels those whose value they have in `padded`: themselves, or their sources."""
        if not len(self.texels):
            return texels
        at = np.searchsorted(self.texels, texels).clip(0, len(self.texels) - 1)
        found: NDArray[np.int32] = np.where(self.texels[at] == texels, self.sources[at], texels)
        return found

    def rows(self, heights: Texels, start: int, stop: int) -> NDArray[Any]:
        """Rows `start` to `stop` of `padded(heights)`, of the same type."""
        side = heights.shape[1]
        out: NDArray[Any] = heights[start:stop].copy()
        # Of the same type, else numpy converts all of the numbers to search among them.
        ends = np.array([start * side, stop * side], self.texels.dtype)
        part = slice(*np.searchsorted(self.texels, ends))
        out.reshape(-1)[self.texels[part] - start * side] = heights.reshape(-1)[self.sources[part]]
        return out


def check_shown(mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Which texels of a UDIM show a triangle; raises MeshError where none does."""
    shown = triangles < len(mesh.faces)
    if not shown.any():
        raise MeshError(f"no texel of UDIM {udim} shows a triangle: the resolution is too low")
    return shown


def local_edges(mesh: Mesh, udim: int) -> FloatArray:
    """(F, 3, 2): the first corner of each triangle, local to a UDIM, and the two edges from it."""
    corners = mesh.triangle_uv() - np.array(udim_origin(udim), np.float64)
    first = corners[:, 0]
    return np.stack([first, corners[:, 1] - first, corners[:, 2] - first], axis=1)


def texels_inside(triangles: NDArray[np.int32], uv_edges: FloatArray) -> NDArray[np.bool_]:
    """(R, R) whether the centre of each texel lies in its triangle (R, R)."""
    side = len(triangles)
    rows = max(_TEXELS // side, 1)
    parts = [slice(start, min(start + rows, side)) for start in range(0, side, rows)]
    return np.concatenate(on_all_cores(partial(_rows_inside, triangles, uv_edges), parts))


def _rows_inside(
    triangles: NDArray[np.int32], uv_edges: FloatArray, rows: slice
) -> NDArray[np.bool_]:
    """Of some rows. A weight is linear along a row, so texels of one triangle that follow one
    another are inside where the first and the last are."""
    here = triangles[rows]
    first, last = np.ones(here.shape, np.bool_), np.ones(here.shape, np.bool_)
    first[:, 1:] = last[:, :-1] = here[:, 1:] != here[:, :-1]
    inside, ends = np.zeros(here.shape, np.bool_), first | last

    def find(where: NDArray[np.bool_]) -> None:
        least = _barycentric(triangles, uv_edges, rows, where).min(axis=1)
        inside[where] = least >= -_ROUNDED

    find(ends)
    whole = inside[first] & inside[last]
    counts = np.flatnonzero(last) - np.flatnonzero(first) + 1
    inside = np.repeat(whole, counts).reshape(here.shape)
    find(~inside)
    return inside


def _barycentric(
    triangles: NDArray[np.int32], uv_edges: FloatArray, rows: slice, where: NDArray[np.bool_]
) -> FloatArray:
    """(K, 3) of those texels of some rows that `where` names; negative outside of a triangle."""
    side = len(triangles)
    row, column = np.nonzero(where)
    a, b, c = np.moveaxis(uv_edges[triangles[rows][where]], 1, 0)
    x = (column + 0.5) / side - a[:, 0]
    y = 1.0 - (row + rows.start + 0.5) / side - a[:, 1]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    area[area == 0.0] = np.nan  # such a triangle holds no texel
    second = (x * c[:, 1] - y * c[:, 0]) / area
    third = (y * b[:, 0] - x * b[:, 1]) / area
    return np.stack([1.0 - second - third, second, third], axis=1)


def nearest_known(known: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(R, R) the number of the nearest texel that is known, row by row."""
    row, column = _nearest_places(known)
    found: NDArray[np.int32] = row * np.int32(known.shape[1]) + column
    return found


def _nearest_inside(
    outside: NDArray[np.bool_], inside: NDArray[np.bool_], reach: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Numbers of texels that are outside, in ascending order, and of the nearest ones inside.

    Blocks are searched where there are such texels; a search of the whole map takes 12 bytes a
    texel. What has none within reach takes the nearest one of some rows around it; where those have
    none either, it is left out.
    """
    side = len(outside)
    starts = range(0, side, _BLOCK)
    blocks = [(row, column) for row in starts for column in starts]
    search = partial(_nearest_of_block, outside, inside, reach)
    near = [found for found in on_all_cores(search, blocks) if found is not None]
    texel = np.concatenate([np.zeros(0, np.int64), *(found[0] for found in near)])
    source = np.concatenate([np.zeros(0, np.int64), *(found[1] for found in near)])
    left = outside.copy()
    left.reshape(-1)[texel] = False
    far = [*_nearest_of_rows(left, inside, reach)]
    texel = np.concatenate([texel, *(found[0] for found in far)])
    source = np.concatenate([source, *(found[1] for found in far)])
    order = np.argsort(texel)
    return texel[order].astype(np.int32), source[order].astype(np.int32)


def _nearest_of_block(
    outside: NDArray[np.bool_], inside: NDArray[np.bool_], reach: int, block: tuple[int, int]
) -> tuple[IntArray, IntArray] | None:
    """Of the texels of a block, those that have a nearest one within reach."""
    side, (top, left) = len(outside), block
    row, column = np.nonzero(outside[top : top + _BLOCK, left : left + _BLOCK])
    first_row, first_column = max(top - reach, 0), max(left - reach, 0)
    near = inside[first_row : top + _BLOCK + reach, first_column : left + _BLOCK + reach]
    if not len(row) or not near.any():
        return None
    rows, columns = _nearest_places(near)
    here = row + (top - first_row), column + (left - first_column)
    to = rows[here].astype(np.int64), columns[here].astype(np.int64)
    close = (to[0] - here[0]) ** 2 + (to[1] - here[1]) ** 2 <= reach**2
    texel = (row + top) * side + column + left
    source = (to[0] + first_row) * side + to[1] + first_column
    return texel[close], source[close]


def _nearest_of_rows(
    outside: NDArray[np.bool_], inside: NDArray[np.bool_], reach: int
) -> Iterator[tuple[IntArray, IntArray]]:
    """Of the texels of some rows at a time, in whole rows and a margin around them."""
    side = len(outside)
    for start in range(0, side, _BLOCK):
        row, column = np.nonzero(outside[start : start + _BLOCK])
        first = max(start - reach, 0)
        near = inside[first : start + _BLOCK + reach]
        if not len(row) or not near.any():
            continue
        rows, columns = _nearest_places(near)
        here = row + (start - first), column
        source = (rows[here].astype(np.int64) + first) * side + columns[here]
        yield (row + start) * side + column, source


def _nearest_places(known: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(2, h, w) row and column of the nearest texel that is known."""
    found: NDArray[np.int32] = scipy.ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return found


def islands_of(mesh: Mesh) -> IntArray:
    """(F,) numbers of parts of the UV layout: triangles that share texture coordinates."""
    _, uv = np.unique(mesh.uv, axis=0, return_inverse=True)
    corner = uv.reshape(-1)[mesh.face_uv]
    pairs = np.concatenate([corner[:, :2], corner[:, 1:]])
    size = len(mesh.uv)
    joined = scipy.sparse.coo_array(
        (np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), (size, size)
    )
    _, parts = scipy.sparse.csgraph.connected_components(joined, directed=False)
    found: IntArray = parts[corner[:, 0]].astype(np.int64)
    return found
