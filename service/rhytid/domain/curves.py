"""A wrinkle graph as lines in space, for programs that know nothing of UV."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.origin import ORIGIN, Centre
from rhytid.domain.seams import whole_wrinkles
from rhytid.domain.surface_points import node_places, surface_points
from rhytid.errors import GraphError


@dataclass(frozen=True, eq=False)
class Curves:
    """C straight lines between P points of a surface.

    points (P, 3) f32, mesh units.  lines (C, 2) i64: the points that each joins.
    widths (C,) f32: across the whole support, mesh units, neutral.  strengths (C,) f32 in (0, 1].
    centre (3,) f64: add it to the points to have them where the mesh was sent.
    """

    points: NDArray[np.float32]
    lines: NDArray[np.int64]
    widths: NDArray[np.float32]
    strengths: NDArray[np.float32]
    centre: Centre = field(default_factory=lambda: ORIGIN)


def with_triangles(
    graph: WrinkleGraph, triangle: NDArray[np.int32], triangles: int
) -> WrinkleGraph:
    """The graph, naming the triangle (N,) of each node; -1 where that is `triangles`, for none."""
    return replace(graph, node_triangle=np.where(triangle < triangles, triangle, -1))


def graph_curves(mesh: Mesh, graph: WrinkleGraph) -> Curves:
    """The wrinkles of strength above 0 from pore to pore; one across a UV seam is one line.

    Left out is what has an end on no triangle (node_triangle -1). Of a wrinkle of which only one
    half is stored the half comes. Raises GraphError where the graph names no triangles.
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
