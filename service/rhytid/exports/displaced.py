"""The surface itself, moved by its displacement: for programs that do not displace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh, add_centre
from rhytid.domain.tiles import udim_origin, udims_at
from rhytid.errors import InputError, LimitError
from rhytid.exports.meshes import FlatMesh, flat_mesh, welded
from rhytid.exports.textures.tangents import unit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
# Triangles of a subdivided mesh: some 200 bytes each while it is made and written, 4 GiB in all.
MOST_TRIANGLES = 20_000_000
# How far towards the middle of its triangle a corner is moved before its UDIM is looked up: it may
# lie on the border of two.
_INWARDS = 1e-6
# Share of the edges that a target is for: single long ones, as at the back of a head, may stay.
# What is longer by no more than rounding is not cut once more.
_EDGES, _ROUNDED = 0.95, 1e-6


@dataclass(frozen=True, eq=False)
class Samples:
    """Where a map (H, W) is read for some vertices: linear between the middles of four texels;
    beyond the outermost middles its values go on.

    vertices: (N,) their numbers.  texels: (4, N) numbers of texels, row by row: upper left, upper
    right, lower left, lower right.  share: (2, N) how far each lies down and to the right of the
    first one.
    """

    vertices: IntArray
    texels: NDArray[np.int32]
    share: FloatArray

    @classmethod
    def of(cls, uv: FloatArray, shape: tuple[int, ...], vertices: IntArray) -> Samples:
        """uv: (N, 2) in the unit square of the map, whose row 0 is at the top."""
        size = np.array(shape)
        place = np.stack([1.0 - uv[:, 1], uv[:, 0]], axis=1) * size - 0.5
        place = np.clip(place, 0.0, size - 1.0)
        low = np.minimum(place.astype(np.int64), np.maximum(size - 2, 0))
        down, right = np.minimum(1, size - 1).tolist()
        (r, c), width = low.T, shape[1]
        four = [(r + y) * width + c + x for y in (0, down) for x in (0, right)]
        return cls(vertices, np.array(four, np.int32), (place - low).T)

    def read(self, heights: NDArray[np.floating]) -> FloatArray:
        """(N,) values of a map."""
        a, b, c, d = heights.reshape(-1)[self.texels]
        y, x = self.share
        top, bottom = a * (1 - x) + b * x, c * (1 - x) + d * x
        found: FloatArray = top * (1 - y) + bottom * y
        return found


@dataclass(frozen=True, eq=False)
class Subdivided:
    """A mesh each of whose triangles is cut in four, `levels` times; no vertex of it is rounded.

    mesh: the mesh that was cut.  flat: its vertices, split along seams.  edges: of each level, (E,
    2) the vertices between which new ones lie.  faces (F', 3), uv (W', 2): of the result.  udim
    (W',): whose map moves a vertex.  welded (W',): the same number for vertices at the same place.
    """

    mesh: Mesh
    flat: FlatMesh
    edges: tuple[IntArray, ...]
    faces: IntArray
    uv: FloatArray
    udim: IntArray
    welded: IntArray

    @classmethod
    def of(cls, mesh: Mesh, levels: int) -> Subdivided:
        """Cut every triangle `levels` times; raises LimitError where there would be too many."""
        count = len(mesh.faces) * 4**levels
        if count > MOST_TRIANGLES:
            raise LimitError(
                f"{len(mesh.faces)} triangles cut {levels} times are {count}: at most "
                f"{MOST_TRIANGLES}"
            )
        flat, edges = flat_mesh(mesh), []
        faces = flat.faces
        vertices = len(flat.positions)
        for _ in range(levels):
            faces, ends = _cut(faces, vertices)
            edges.append(ends)
            vertices += len(ends)
        uv = _spread(flat.uv, edges)
        welded = _welded(mesh, flat, edges)
        return cls(mesh, flat, tuple(edges), faces, uv, _udims(uv, faces), welded)

    def samples(self, udim: int, shape: tuple[int, ...]) -> Samples:
        """Where the map of a UDIM, of a shape, is read."""
        some = np.flatnonzero(self.udim == udim)
        return Samples.of(self.uv[some] - udim_origin(udim), shape, some)

    @cached_property
    def _places(self) -> tuple[IntArray, IntArray]:
        """Numbers of places of the vertices of the mesh, and the first vertex of each."""
        place = welded(self.mesh)
        return place, np.unique(place, return_index=True)[1]

    def moved(
        self,
        positions: NDArray[np.float32],
        maps: Mapping[int, NDArray[np.floating]],
        *,
        curved: bool = False,
        samples: Mapping[int, Samples] = MappingProxyType({}),
    ) -> FlatMesh:
        """A frame with its displacement.

        positions (V, 3): of the mesh, less its centre.  maps: by UDIM, (H, W) heights in mesh
        units, row 0 at the top; vertices of UDIMs without one stay.  samples: by UDIM, where they
        are read, where that is known from a frame before.

        Each vertex moves along the normal of the frame by the height that its map has there,
        interpolated between the nearest four texels. Vertices that a seam splits move by the mean
        of both sides, so that no gap opens.  curved: new vertices lie on a surface that is curved
        by the normals, not in the triangles, so that no facets show.
        """
        there, normals = self._undisplaced(positions, curved)
        heights = np.zeros(len(self.uv))
        for udim, map in maps.items():
            taken = samples.get(udim) or self.samples(udim, map.shape)
            heights[taken.vertices] = taken.read(map)
        many = np.bincount(self.welded)
        heights = (np.bincount(self.welded, heights) / many)[self.welded]
        out = add_centre(there + heights[:, None] * normals, self.mesh.centre)
        out = out if self.mesh.centre.any() else out.astype(np.float32)
        return FlatMesh(out, self.faces, self.uv, np.zeros(0, np.int64))

    def _undisplaced(
        self, positions: NDArray[np.float32], curved: bool
    ) -> tuple[FloatArray, FloatArray]:
        """(W', 3) all vertices of a frame without displacement, and (W', 3) unit normals there."""
        there = positions.astype(np.float64)[self.flat.source]
        normals = _normals(positions, self.mesh, *self._places)[self.flat.source]
        if curved:
            return _curved(there, normals, self.edges)
        return _spread(there, self.edges), unit(_spread(normals, self.edges))


def levels_for(mesh: Mesh, edge: float) -> int:
    """How many times triangles must be cut so that all edges but the longest twentieth are no
    longer than `edge`, mesh units; raises InputError where that is no length."""
    if not (np.isfinite(edge) and edge > 0.0):
        raise InputError(f"an edge of {edge:g}: must be a length above 0")
    corners = mesh.positions[mesh.faces].astype(np.float64)
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    halvings = np.log2(np.quantile(lengths, _EDGES) / edge)
    return max(int(np.ceil(halvings - _ROUNDED)), 0) if np.isfinite(halvings) else 0


def _cut(faces: IntArray, vertices: int) -> tuple[IntArray, IntArray]:
    """Four triangles for each, and the edges in whose middles the new vertices lie, in order."""
    import trimesh

    tri: Any = trimesh.Trimesh(np.zeros((vertices, 3)), faces, process=False, validate=False)
    a, b, c = faces.T
    ab, bc, ca = np.asarray(tri.faces_unique_edges, np.int64).T + vertices
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    parts = np.stack([np.stack(one, axis=1) for one in four], axis=1)
    return parts.reshape(-1, 3), np.asarray(tri.edges_unique, np.int64)


def _spread(values: FloatArray, edges: tuple[IntArray, ...] | list[IntArray]) -> FloatArray:
    """Values of vertices, and of those in the middles of edges, level by level."""
    for ends in edges:
        values = np.concatenate([values, 0.5 * (values[ends[:, 0]] + values[ends[:, 1]])])
    return values


def _curved(
    places: FloatArray, normals: FloatArray, edges: tuple[IntArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Places and normals of vertices, and of new ones on cubic curves between the ends of edges.

    A curve leaves each end at right angles to its normal, as edges of PN triangles do (Vlachos et
    al. 2001): its middle is off that of the edge by an eighth of how far each end sees the other
    above or below its tangent plane.
    """
    normals = unit(normals)
    for ends in edges:
        (a, b), (m, n) = np.moveaxis(places[ends], 1, 0), np.moveaxis(normals[ends], 1, 0)
        above = np.sum((b - a) * m, axis=1, keepdims=True) * m
        below = np.sum((b - a) * n, axis=1, keepdims=True) * n
        places = np.concatenate([places, 0.5 * (a + b) + 0.125 * (below - above)])
        normals = np.concatenate([normals, unit(m + n)])
    return places, normals


def _welded(mesh: Mesh, flat: FlatMesh, edges: list[IntArray]) -> IntArray:
    """(W',) numbers of places: of a vertex of the neutral, or of the middle of two."""
    number = welded(mesh)[flat.source]
    for ends in edges:
        pair = np.sort(number[ends], axis=1)
        _, middle = np.unique(pair, axis=0, return_inverse=True)
        number = np.concatenate([number, number.max() + 1 + middle.reshape(-1)])
    return number


def _udims(uv: FloatArray, faces: IntArray) -> IntArray:
    """(W',) UDIMs of vertices; of one on a border, that of a triangle of its own."""
    place = uv.copy()
    middle = uv[faces].mean(axis=1)
    for corner in range(3):
        at = faces[:, corner]
        place[at] = uv[at] + _INWARDS * (middle - uv[at])
    return udims_at(place)


def _normals(
    positions: NDArray[np.float32], mesh: Mesh, place: IntArray, first: IntArray
) -> FloatArray:
    """(V, 3) of a frame, by the angles of its triangles; over seams as within charts.

    place: (V,) numbers of places.  first: a vertex of each.
    """
    import trimesh

    tri: Any = trimesh.Trimesh(positions[first], place[mesh.faces], process=False, validate=False)
    normals: FloatArray = np.asarray(tri.vertex_normals, np.float64)[place]
    return normals
