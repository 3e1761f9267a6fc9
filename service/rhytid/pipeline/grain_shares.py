"""Roughness of the skin at each texel, from the values at a graph's pores: found once per asset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh

# How many edges from a pore on its value is carried over vertices without any; beyond, the mean.
_CARRIED = 64


def grain_shares(
    mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.integer]
) -> NDArray[np.float32] | None:
    """(F, 3) factor of the grain at the corners of each triangle, None where the graph has none.

    triangle: (N,) of each node, F for none. A vertex takes the mean of the pores on its triangles,
    so that there is no step at seams or edges; where there are none, that of its neighbours.
    """
    if graph.node_grain is None:
        return None
    own = np.flatnonzero(graph.own_nodes & (triangle >= 0) & (triangle < len(mesh.faces)))
    vertices, values = mesh.faces[triangle[own]], graph.node_grain[own].astype(np.float64)
    total, count = (
        np.bincount(vertices.ravel(), weights, len(mesh.positions)).astype(np.float64)
        for weights in (np.repeat(values, 3), None)
    )
    if not count.any():
        return np.ones((len(mesh.faces), 3), np.float32)
    found = np.divide(total, count, out=np.zeros_like(total), where=count > 0)
    _carry(mesh, found, count > 0)
    return found[mesh.faces].astype(np.float32)


def _carry(mesh: Mesh, values: NDArray[np.float64], known: NDArray[np.bool_]) -> None:
    """Give vertices without a value the mean of those around them, in place, outwards."""
    mean = float(values[known].mean())
    one, two = mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    to, of = np.concatenate([one, two]), np.concatenate([two, one])
    for _ in range(_CARRIED):
        reached = known[of] & ~known[to]
        if not reached.any():
            break
        count = np.bincount(to[reached], None, len(values))
        total = np.bincount(to[reached], values[of[reached]], len(values))
        fresh = count > 0
        values[fresh] = total[fresh] / count[fresh]
        known |= fresh
    values[~known] = mean
