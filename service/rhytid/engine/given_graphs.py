"""Graphs that were sent: whether they fit a mesh, and the lengths that they are drawn with."""

from __future__ import annotations

from dataclasses import replace

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import GraphError


def graph_lengths(
    graph: WrinkleGraph, settings: AssetSettings, distance: float, spacing: float | None = None
) -> Lengths:
    """What a graph is drawn with where settings do not say it, in their unit.

    distance: mean, of its pores.  spacing: that it was grown with; where that is not known,
    `graph.spacing` of the settings, else what its file says, else the distance. Raises
    SettingsError where the lengths of the file cannot be converted.
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
