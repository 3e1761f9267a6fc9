"""Which pores and wrinkles are stored more than once because of UV seams (see WrinkleGraph).

Graphs say so in `node_copy_of` and `edge_copy_of`; older ones hold two halves of each wrinkle
across a seam instead, which are found by how they lie.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.surface_points import node_places

# A half points at the pore of the other half: the least cosine of its angle to the way there, for
# it lies in the plane of one triangle and the other pore does not, at folds not by far; and the
# most of the way that it goes, with room for rounding.
_COSINE, _MOST = 0.1, 1.05


def seam_halves(mesh: Mesh, graph: WrinkleGraph) -> NDArray[np.int64]:
    """(P, 2) wrinkles that are stored once per side of a seam: the rows of their two halves.

    Halves follow one another, are equally strong, and go from a pore to a node of no strength that
    nothing else uses, each towards the pore of the other. None are found in a graph that names its
    copies, or does not name the triangles of its pores.
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


def whole_wrinkles(mesh: Mesh, graph: WrinkleGraph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (W,) of the wrinkles, each once, and the nodes (W, 2) that each joins: of one across a
    seam the original, or its first half, and both of its pores."""
    if graph.edge_copy_of is not None or graph.node_copy_of is not None:
        rows = np.flatnonzero(graph.own_edges)
        return rows, graph.original_nodes(graph.edge_nodes[rows]).astype(np.int64)
    pairs = seam_halves(mesh, graph)
    nodes = graph.edge_nodes.astype(np.int64)
    nodes[pairs[:, 0], 1] = nodes[pairs[:, 1], 0]
    rows = np.delete(np.arange(graph.wrinkles), pairs[:, 1])
    return rows, nodes[rows]


def _half(graph: WrinkleGraph, triangle: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(M,) from a pore on a known triangle to a node beyond the border of the chart."""
    near, beyond = graph.edge_nodes.T
    used = np.bincount(graph.edge_nodes.ravel(), minlength=graph.pores)
    known = (triangle[near] >= 0) & (triangle[near] == triangle[beyond])
    half: NDArray[np.bool_] = known & (graph.node_weight[beyond] == 0) & (used[beyond] == 1)
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
