"""Places on the surface of a mesh: from a triangle and texture coordinates to a point in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh


def surface_points(
    mesh: Mesh, uv: NDArray[np.floating], triangle: NDArray[np.integer]
) -> NDArray[np.float64]:
    """(P, 3) points of the surface at texture coordinates (P, 2) of known triangles; coordinates
    outside their triangle go on in its plane."""
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
