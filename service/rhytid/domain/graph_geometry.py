"""A wrinkle graph on the surface of its mesh: places, wrinkles across UV seams, curves in space.

Graphs name what they store more than once because of UV seams in `node_copy_of` and `edge_copy_of`
(see WrinkleGraph). Older ones hold two halves of each wrinkle across a seam instead, which are
found by how they lie.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.errors import GraphError

# A half points at the pore of the other half: the least cosine of its angle to the way there, for
# it lies in the plane of one triangle and the other pore does not, at folds not by far; and the
# most of the way that it goes, with room for rounding.
_COSINE, _MOST = 0.1, 1.05
# Wrinkles that are looked up at a time: what is computed on the way stays in the cache.
_ROWS = 1 << 16


@dataclass(frozen=True, eq=False)
class Curves:
    """C straight lines between P points of a surface.

    points: (P, 3) f32, mesh units.  lines: (C, 2) i64, the points that each line joins.
    widths: (C,) f32, across the whole support of the neutral, mesh units.
    strengths: (C,) f32 in (0, 1].  centre: (3,) f64; add it to the points to have them where the
    mesh was sent.
    """

    points: NDArray[np.float32]
    lines: NDArray[np.int64]
    widths: NDArray[np.float32]
    strengths: NDArray[np.float32]
    centre: Centre = field(default_factory=lambda: ORIGIN)


def with_triangles(
    graph: WrinkleGraph, triangle: NDArray[np.int32], triangles: int
) -> WrinkleGraph:
    """The graph with the triangle of each node.

    triangle: (N,) triangles; `triangles`, their number in the mesh, stands for none.
    """
    return replace(graph, node_triangle=np.where(triangle < triangles, triangle, -1))


def graph_curves(mesh: Mesh, graph: WrinkleGraph) -> Curves:
    """The wrinkles of strength above 0, from pore to pore; one across a UV seam is one line.

    Wrinkles with an end on no triangle (node_triangle -1) are left out. A wrinkle of which only one
    half is stored is that half. Raises GraphError where the graph names no triangles.
    """
    if graph.node_triangle is None:
        raise GraphError("node_triangle is missing: curves need the triangle of every pore")
    rows, nodes = whole_wrinkles(mesh, graph)
    kept = (graph.edge_weight[rows] > 0) & (graph.node_triangle[nodes] >= 0).all(axis=1)
    rows, lines = rows[kept], nodes[kept]
    used = np.unique(lines)
    return Curves(
        node_places(mesh, graph, used).astype(np.float32),
        np.searchsorted(used, lines),
        surface_widths(mesh, graph, rows).astype(np.float32),
        graph.edge_weight[rows],
        mesh.centre,
    )


def surface_widths(mesh: Mesh, graph: WrinkleGraph, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """(K,) widths on the surface of some wrinkles (K,), mesh units: twice the half width in UV,
    times |step| in UV and surface area per UV area, over the length on the surface."""
    assert graph.node_triangle is not None
    ends, triangle = graph.edge_nodes[rows], graph.node_triangle[graph.edge_nodes[rows, 0]]
    if graph.edge_triangle is not None:
        triangle = np.where(graph.edge_triangle[rows] >= 0, graph.edge_triangle[rows], triangle)
    start, stop = (graph.node_uv[ends[:, i]].astype(np.float64) for i in (0, 1))
    there = surface_points(mesh, stop, triangle) - surface_points(mesh, start, triangle)
    length, in_uv = (np.linalg.norm(step, axis=1) for step in (there, stop - start))
    across = 2.0 * graph.edge_half_width[rows] * in_uv * _density(mesh, triangle)
    widths: NDArray[np.float64] = np.divide(
        across, length, out=np.zeros_like(across), where=length > 0
    )
    return widths


def surface_points(
    mesh: Mesh, uv: NDArray[np.floating], triangle: NDArray[np.integer]
) -> NDArray[np.float64]:
    """(P, 3) points of the surface at texture coordinates (P, 2) in triangles (P,).

    Coordinates outside of their triangle are extended in its plane.
    """
    a, b, c = np.moveaxis(mesh.triangle_uv()[triangle], 1, 0)
    first, second, gap = b - a, c - a, uv - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(area == 0.0, 1.0, area)
    x = (gap[:, 0] * second[:, 1] - gap[:, 1] * second[:, 0]) / area
    y = (first[:, 0] * gap[:, 1] - first[:, 1] * gap[:, 0]) / area
    p, q, r = np.moveaxis(mesh.positions[mesh.faces[triangle]].astype(np.float64), 1, 0)
    points: NDArray[np.float64] = p + x[:, None] * (q - p) + y[:, None] * (r - p)
    return points


def node_places(mesh: Mesh, graph: WrinkleGraph, nodes: NDArray[np.integer]) -> NDArray[np.float64]:
    """(K, 3) points of some nodes (K,) of a graph that names their triangles."""
    assert graph.node_triangle is not None
    return surface_points(mesh, graph.node_uv[nodes], graph.node_triangle[nodes])


def whole_wrinkles(mesh: Mesh, graph: WrinkleGraph) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Rows (W,) of the wrinkles, each once, and the nodes (W, 2) that each joins.

    A wrinkle across a seam has the row of the original or of its first half, and both its pores.
    """
    if graph.edge_copy_of is not None or graph.node_copy_of is not None:
        rows = np.flatnonzero(graph.own_edges)
        nodes = np.empty((len(rows), 2), np.int32)
        for start in range(0, len(rows), _ROWS):
            some = slice(start, start + _ROWS)
            nodes[some] = graph.original_nodes(graph.edge_nodes[rows[some]])
        return rows, nodes
    pairs = seam_halves(mesh, graph)
    nodes = graph.edge_nodes.copy()
    if not len(pairs):
        return np.arange(len(nodes)), nodes
    nodes[pairs[:, 0], 1] = nodes[pairs[:, 1], 0]
    rows = np.delete(np.arange(graph.wrinkles), pairs[:, 1])
    return rows, nodes[rows]


def seam_halves(mesh: Mesh, graph: WrinkleGraph) -> NDArray[np.int64]:
    """(P, 2) rows of the two halves of wrinkles that are stored once per side of a seam.

    Halves follow one another, are equally strong, and go from a pore to a node of no strength that
    no other wrinkle uses, each towards the pore of the other. There are none in a graph that names
    its copies, or does not name the triangles of its pores.
    """
    if graph.node_triangle is None or graph.edge_copy_of is not None:
        return np.zeros((0, 2), np.int64)
    half = _half(graph, graph.node_triangle)
    first = np.flatnonzero(half[:-1] & half[1:])
    weight, pore = graph.edge_weight, graph.edge_nodes[:, 0]
    first = first[(weight[first] == weight[first + 1]) & (pore[first] != pore[first + 1])]
    first = first[_towards(mesh, graph, first, first + 1)]
    first = first[_towards(mesh, graph, first + 1, first)]
    # Of halves in a row that all match, the first two are one, then the next two.
    start = np.diff(first, prepend=-2) != 1
    run = np.maximum.accumulate(np.where(start, np.arange(len(first)), 0))
    first = first[(np.arange(len(first)) - run) % 2 == 0]
    return np.stack([first, first + 1], axis=1)


def _density(mesh: Mesh, triangle: NDArray[np.int32]) -> NDArray[np.float64]:
    """(K,) surface area per UV area; 0 for a triangle without area in UV."""
    a, b, c = np.moveaxis(mesh.triangle_uv()[triangle], 1, 0)
    u, w = b - a, c - a
    area_uv = np.abs(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
    p, q, r = np.moveaxis(mesh.positions[mesh.faces[triangle]].astype(np.float64), 1, 0)
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1)
    density: NDArray[np.float64] = np.divide(
        area, area_uv, out=np.zeros_like(area), where=area_uv > 0
    )
    return density


def _half(graph: WrinkleGraph, triangle: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(M,) from a pore on a known triangle to a node beyond the border of the chart."""
    half = np.empty(graph.wrinkles, np.bool_)
    for start in range(0, graph.wrinkles, _ROWS):
        near, beyond = graph.edge_nodes[start : start + _ROWS].T
        known = (triangle[near] >= 0) & (triangle[near] == triangle[beyond])
        half[start : start + _ROWS] = known & (graph.node_weight[beyond] == 0)
    if half.any():
        used = np.bincount(graph.edge_nodes.ravel(), minlength=graph.pores)
        half &= used[graph.edge_nodes[:, 1]] == 1
    return half


def _towards(
    mesh: Mesh, graph: WrinkleGraph, half: NDArray[np.int64], other: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(H,) whether each half goes towards the pore of the other, and no further."""
    near, beyond = graph.edge_nodes[half].T
    pore, end, across = (
        node_places(mesh, graph, node) for node in (near, beyond, graph.edge_nodes[other, 0])
    )
    step, way = end - pore, across - pore
    gone, whole = (np.linalg.norm(v, axis=-1) for v in (step, way))
    ahead: NDArray[np.bool_] = (step * way).sum(-1) >= _COSINE * gone * whole
    short: NDArray[np.bool_] = (gone > 0) & (gone <= _MOST * whole)
    return ahead & short
