"""Graphs of assets: whether one fits a mesh, the lengths that it is drawn with, and how far its
pores stand apart, which is the unit in which depth and blur are chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.graph_geometry import surface_points
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import GraphError


def graph_lengths(
    graph: WrinkleGraph, settings: AssetSettings, distance: float, spacing: float | None = None
) -> Lengths:
    """The lengths that a graph is drawn with where settings do not say them, in the unit of the
    settings.

    distance: mean distance of its pores.  spacing: the spacing that it was grown with; where that
    is not known, `graph.spacing` of the settings, else the one of its file, else the distance.
    Raises SettingsError where the lengths of the file cannot be converted.
    """
    unit = settings.length_unit
    origin = (graph.origin or GraphOrigin()).in_unit(unit)
    known = settings.graph.spacing if spacing is None else spacing
    if known is not None:
        origin = replace(origin, spacing=known)
    return origin.lengths(unit, distance)


def check_graph(graph: WrinkleGraph, mesh: Mesh, *, force: bool) -> None:
    """Raise GraphError where the graph was made for another mesh, unless `force`, or samples a
    triangle that the mesh does not have."""
    if graph.origin is not None and not force:
        graph.origin.check_mesh(mesh)
    triangles = len(mesh.faces)
    for name in ("node_triangle", "edge_triangle"):
        index = getattr(graph, name)
        if index is not None and len(index) and index.max() >= triangles:
            row = int(index.argmax())
            raise GraphError(
                f"{name}[{row}] is {index[row]}: the mesh has {plural(triangles, 'triangle')}; "
                "is it a graph of another mesh?"
            )


def mean_spacing(mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32]) -> float:
    """Mean distance from a pore to the nearest one elsewhere, in mesh units.

    triangle: (N,) the triangle that holds each pore; a pore with the number of triangles lies in
    none and is left out. Copies at UV seams do not count; nodes of weight 0, such as those beyond
    seams, count only where no others lie at two places. Falls back to the mean length of a mesh
    edge where none do.
    """
    on_mesh = (triangle < len(mesh.faces)) & graph.own_nodes
    for chosen in (on_mesh & (graph.pore_weight > 0), on_mesh):
        places = surface_points(mesh, graph.node_uv[chosen], triangle[chosen])
        places = np.unique(places, axis=0)  # of pores that coincide one counts
        if len(places) >= 2:
            distance, _ = scipy.spatial.cKDTree(places).query(places, k=2)
            return float(distance[:, 1].mean())
    corners = mesh.positions[mesh.faces].astype(np.float64)
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).mean())
