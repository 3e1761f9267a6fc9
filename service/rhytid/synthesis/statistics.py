"""Figures of a wrinkle graph on its mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError
from rhytid.synthesis.crossings import crossings
from rhytid.synthesis.pores import mean_spacing
from rhytid.synthesis.surface import Points, Surface

BINS = 10


def statistics(mesh: Mesh, graph: WrinkleGraph) -> dict[str, Any]:
    """Plain values for JSON.

    pores: nodes in the graph.  drawn_pores: those of weight above 0, of which the rest tells.
    spacing: mean and deviation of the distance from a pore to the nearest on the surface, mesh
    units.  degree: wrinkles per pore.  crossings: pairs of wrinkles that cross, per wrinkle.
    strengths: wrinkles by weight, in tenths from 0 to 1.  Raises
    GraphError where the graph does not say on which triangles its pores lie.
    """
    surface = Surface.of(mesh)
    drawn = graph.node_weight > 0
    points = _points(surface, graph)
    pores = points.take(drawn)
    number = np.cumsum(drawn) - 1
    both = drawn[graph.edge_nodes].all(axis=1)
    nodes = number[graph.edge_nodes[both]]
    ends = pores.position[nodes]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)
    mean, deviation = mean_spacing(pores, np.inf)
    histogram, _ = np.histogram(graph.edge_weight, BINS, (0.0, 1.0))
    touched = np.count_nonzero(drawn[graph.edge_nodes])
    return {
        "pores": graph.pores,
        "drawn_pores": len(pores),
        "wrinkles": graph.wrinkles,
        "spacing": {"mean": mean * surface.scale, "deviation": deviation * surface.scale},
        "degree": int(touched) / max(len(pores), 1),
        "crossings": len(crossings(pores, nodes, length)) / max(graph.wrinkles, 1),
        "strengths": histogram.tolist(),
    }


def _points(surface: Surface, graph: WrinkleGraph) -> Points:
    """The nodes on the surface, with the normals of their triangles."""
    if graph.node_triangle is None or (graph.node_triangle < 0).any():
        raise GraphError("node_triangle is missing: statistics need the triangle of every pore")
    triangle = graph.node_triangle.astype(np.int64)
    uv = graph.node_uv.astype(np.float64)
    normal = surface.normals[triangle].mean(axis=1)
    return Points(triangle, uv, surface.place(triangle, uv), normal)
