"""How far pores stand apart on the surface: the unit in which depth and blur are chosen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh


def mean_spacing(mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32]) -> float:
    """Mean distance from a pore to the nearest one elsewhere, in mesh units.

    triangle: (N,) that holds each pore; the number of triangles for a pore in none, left out.
    Falls back to the mean length of a mesh edge where pores lie at fewer than two places of the
    mesh.
    """
    on_mesh = triangle < len(mesh.faces)
    places = surface_points(mesh, graph.node_uv[on_mesh], triangle[on_mesh])
    places = np.unique(places, axis=0)  # of pores that coincide one counts
    if len(places) < 2:
        corners = mesh.positions[mesh.faces].astype(np.float64)
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).mean())
    distance, _ = cKDTree(places).query(places, k=2)
    return float(distance[:, 1].mean())


def surface_points(
    mesh: Mesh, uv: NDArray[np.float32], triangle: NDArray[np.int32]
) -> NDArray[np.float64]:
    """(P, 3) points of the surface at texture coordinates (P, 2) of known triangles."""
    a, b, c = np.moveaxis(mesh.triangle_uv()[triangle], 1, 0)
    first, second, gap = b - a, c - a, uv - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    area = np.where(area == 0.0, 1.0, area)
    x = (gap[:, 0] * second[:, 1] - gap[:, 1] * second[:, 0]) / area
    y = (first[:, 0] * gap[:, 1] - first[:, 1] * gap[:, 0]) / area
    p, q, r = np.moveaxis(mesh.positions[mesh.faces[triangle]].astype(np.float64), 1, 0)
    points: NDArray[np.float64] = p + x[:, None] * (q - p) + y[:, None] * (r - p)
    return points
