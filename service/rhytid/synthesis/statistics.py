"""Figures of a wrinkle graph on its mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError
from rhytid.synthesis.crossings import crossings
from rhytid.synthesis.rows import row_blocks
from rhytid.synthesis.spacing import mean_spacing
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.workspace import Workspace

BINS = 10


def statistics(mesh: Mesh, graph: WrinkleGraph, device: Device) -> dict[str, Any]:
    """Plain values for JSON.

    pores: nodes in the graph.  drawn_pores: those of weight above 0, of which the rest tells.
    spacing: mean and deviation of the distance from a pore to the nearest on the surface, mesh
    units.  degree: wrinkles per pore.  crossings: pairs of wrinkles that cross, per wrinkle.
    strengths: wrinkles by weight, in tenths from 0 to 1.  Raises
    GraphError where the graph does not say on which triangles its pores lie.
    """
    surface = Surface.of(mesh)
    drawn = graph.node_weight > 0
    pores = _points(surface, graph, np.flatnonzero(drawn))
    number = np.cumsum(drawn, dtype=np.int32) - np.int32(1)
    both = drawn[graph.edge_nodes].all(axis=1)
    nodes = number[graph.edge_nodes[both]]
    with Workspace(device) as work:
        mean, deviation = mean_spacing(work, pores)
        crossing = len(crossings(work, pores, nodes, _lengths(pores, nodes)))
    histogram, _ = np.histogram(graph.edge_weight, BINS, (0.0, 1.0))
    touched = np.count_nonzero(drawn[graph.edge_nodes])
    return {
        "pores": graph.pores,
        "drawn_pores": len(pores),
        "wrinkles": graph.wrinkles,
        "spacing": {"mean": mean * surface.scale, "deviation": deviation * surface.scale},
        "degree": int(touched) / max(len(pores), 1),
        "crossings": crossing / max(graph.wrinkles, 1),
        "strengths": histogram.tolist(),
    }


def _lengths(pores: Points, nodes: NDArray[np.int32]) -> NDArray[np.float32]:
    """(E,) distances of the nodes (E, 2)."""
    lengths = np.empty(len(nodes), np.float32)
    for rows in row_blocks(len(nodes)):
        one, two = (pores.position[end] for end in nodes[rows].T)
        lengths[rows] = np.linalg.norm(one - two, axis=-1)
    return lengths


def _points(surface: Surface, graph: WrinkleGraph, chosen: NDArray[np.intp]) -> Points:
    """The chosen nodes on the surface, with the normals of their triangles."""
    if graph.node_triangle is None or (graph.node_triangle < 0).any():
        raise GraphError("node_triangle is missing: statistics need the triangle of every pore")
    triangle, uv = graph.node_triangle[chosen], graph.node_uv[chosen]
    position = np.empty((len(chosen), 3))
    for rows in row_blocks(len(chosen)):
        position[rows] = surface.place(triangle[rows], uv[rows].astype(np.float64))
    normal = surface.normals.mean(axis=1).astype(np.float32)[triangle]
    return Points(triangle, uv, position, normal)
