"""Graphs as they were stored before copies: two halves for each wrinkle across a seam."""

from __future__ import annotations

import numpy as np

from rhytid.domain.graph import WrinkleGraph


def in_halves(graph: WrinkleGraph) -> WrinkleGraph:
    """A synthesised graph whose wrinkles across seams go from each of their pores to a node of no
    strength at the other, one after the other, and that knows of no copies."""
    own, first = graph.own_edges, graph.original_nodes(graph.edge_nodes)
    crossing = (first != graph.edge_nodes).any(axis=1) & own
    rows, nodes, extra, near_extra = [], [], [], []
    pores = int(np.count_nonzero(graph.own_nodes))
    for row in np.flatnonzero(own):
        rows.append(row)
        if not crossing[row]:
            nodes.append(graph.edge_nodes[row])
            continue
        copy = next(
            c
            for c in np.flatnonzero(graph.edge_copy_of == row)
            if np.allclose(
                graph.node_uv[graph.edge_nodes[c, 1]], graph.node_uv[first[row, 1]], atol=2e-3
            )
        )
        for edge, (near, beyond) in ((row, (0, 1)), (copy, (1, 0))):
            nodes.append([first[row, near], pores + len(extra)])
            extra.append(graph.edge_nodes[edge, beyond])
            near_extra.append(graph.edge_nodes[edge, near])
        rows.append(copy)
    kept = np.concatenate([np.arange(pores), np.array(extra, int)])
    arrays = {n: a[kept] for n, a in graph.arrays().items() if n.startswith("node")}
    short = arrays["node_uv"].copy()
    # They end some way beyond the seam.
    short[pores:] = 0.2 * graph.node_uv[near_extra] + 0.8 * graph.node_uv[extra]
    arrays["node_uv"] = short
    triangle = arrays["node_triangle"].copy()
    triangle[pores:] = graph.node_triangle[graph.original_nodes(np.array(near_extra, int))]
    arrays["node_triangle"] = triangle
    arrays |= {n: a[rows] for n, a in graph.arrays().items() if n.startswith("edge")}
    bends = ("edge_slopes", "edge_end_weights", "edge_end_half_widths", "edge_partners")
    for name in ("node_copy_of", "edge_copy_of", "edge_metric", *bends):
        arrays.pop(name)
    return WrinkleGraph(**{**arrays, "edge_nodes": np.array(nodes)})
