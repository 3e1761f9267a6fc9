"""How far pores stand apart on the surface: the unit in which depth and blur are chosen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import surface_points
from rhytid.domain.mesh import Mesh


def mean_spacing(mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32]) -> float:
    """Mean distance from a pore to the nearest one elsewhere, in mesh units.

    triangle: (N,) that holds each pore; the number of triangles for a pore in none, left out.
    Copies at UV seams do not count, and nodes of weight 0, as those beyond seams, only where no
    others lie at two places. Falls back to the mean length of a mesh edge where none do.
    """
    on_mesh = (triangle < len(mesh.faces)) & graph.own_nodes
    for chosen in (on_mesh & (graph.node_weight > 0), on_mesh):
        places = surface_points(mesh, graph.node_uv[chosen], triangle[chosen])
        places = np.unique(places, axis=0)  # of pores that coincide one counts
        if len(places) >= 2:
            distance, _ = cKDTree(places).query(places, k=2)
            return float(distance[:, 1].mean())
    corners = mesh.positions[mesh.faces].astype(np.float64)
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).mean())
