"""Figures of a wrinkle graph on its mesh, and how far its pores stand apart. Kernel: nearest.cl."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import whole_wrinkles
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError
from rhytid.synthesis.edges import DEFINES, crossings
from rhytid.synthesis.fields import level_directions
from rhytid.synthesis.lattice import DevicePoints
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface
from rhytid.synthesis.workspace import Workspace

STRENGTHS = 10  # tenths from 0 to 1
ANGLES = 9  # of ten degrees, from 0 to 90
# The first look goes so far, in spacings that the points would have on a flat square of area 1;
# those that find nothing look on twice as far.
_FIRST = 2.0


def statistics(mesh: Mesh, graph: WrinkleGraph, device: Device) -> dict[str, Any]:
    """Figures of a graph, as plain values for JSON.

    pores, wrinkles: how many the graph holds, without copies at UV seams.  drawn_pores,
    drawn_wrinkles: how many of these have a strength above 0.  copied_pores, copied_wrinkles: how
    many copies there are.  seam_wrinkles: how many wrinkles join pores on two sides of a seam.
    events: how many there are of each kind, without copies; they are no pores.

    The others are of what is drawn, each pore and wrinkle once. distance: mean and deviation of the
    distance from a pore to the nearest on the surface, mesh units.  length: mean and deviation of
    the length of wrinkles, mesh units.  degree: wrinkles at a pore, mean, and how many pores have
    0, 1, 2 … of them.  crossings: pairs of wrinkles that cross, per wrinkle. strengths: wrinkles by
    weight, in tenths from 0 to 1. angles: wrinkles by their angle on the surface to the level
    around the vertical axis, which synthesis prefers, in tens of degrees from 0 to 90.
    angle_strengths: the mean weight of each.

    Nodes on no triangle (-1) are left out. Raises GraphError where the graph does not say on which
    triangles its pores lie.
    """
    surface = Surface.of(mesh)
    net = _net(mesh, surface, graph)
    with Workspace(device) as work:
        mean, deviation = mean_spacing(work, net.points.take(net.pores))
        crossing = len(crossings(work, net.points, net.nodes, net.length.astype(np.float32)))
    count = max(len(net.weight), 1)
    pores, wrinkles = graph.counts()
    return {
        "pores": pores,
        "drawn_pores": int(np.count_nonzero(graph.pore_weight[graph.own_nodes])),
        "copied_pores": int(np.count_nonzero(graph.pore_weight[~graph.own_nodes])),
        "wrinkles": wrinkles,
        "drawn_wrinkles": int(np.count_nonzero(graph.edge_weight[graph.own_edges])),
        "copied_wrinkles": graph.wrinkles - wrinkles,
        "seam_wrinkles": net.seams,
        "events": graph.event_counts(),
        "distance": {"mean": mean * surface.scale, "deviation": deviation * surface.scale},
        "length": _moments(net.length * surface.scale),
        "degree": _degrees(net),
        "crossings": crossing / count,
        "strengths": np.histogram(net.weight, STRENGTHS, (0.0, 1.0))[0].tolist(),
        **_angles(net),
    }


def mean_spacing(work: Workspace, pores: Points) -> tuple[float, float]:
    """Mean and deviation of the distance from a pore to the nearest on its sheet; both 0 where no
    pore has another."""
    distance = nearest_distances(work, pores)
    found = distance[np.isfinite(distance)].astype(np.float64)
    return (float(found.mean()), float(found.std())) if len(found) else (0.0, 0.0)


def nearest_distances(work: Workspace, pores: Points) -> NDArray[np.float32]:
    """(N,) distance of each pore to the nearest of its sheet; infinity where there is none."""
    distance = np.full(len(pores), np.inf, np.float32)
    if len(pores) < 2:
        return distance
    extent = float(np.ptp(pores.position, axis=0).max())
    cell = min(_FIRST / np.sqrt(len(pores)), extent)
    left = np.arange(len(pores), dtype=np.int32)
    while len(left):
        with work.nested() as nested:
            distance[left] = _within(nested, pores, left, cell)
        left = left[np.isinf(distance[left])] if cell < extent else left[:0]
        cell = min(2.0 * cell, extent)
    return distance


def _within(
    work: Workspace, pores: Points, asked: NDArray[np.int32], cell: float
) -> NDArray[np.float32]:
    """(K,) distances of pores `asked` (K,) to the nearest, infinity where it is farther than
    `cell`."""
    cloud = DevicePoints.of(work, pores, cell)
    nearest2 = work.empty(len(asked), np.float32)
    work.run(
        "nearest", "nearest_distance", len(asked), work.upload(asked), *cloud.points,
        *cloud.grid.arguments, float(cloud.lattice.unit / cell), nearest2, defines=DEFINES,
    )  # fmt: skip
    found = work.read(nearest2, (len(asked),), np.float32)
    distances: NDArray[np.float32] = np.float32(cell) * np.sqrt(found)
    return distances


@dataclass(frozen=True, eq=False)
class _Net:
    """The drawn part of a graph.  points (N,): the nodes on the surface.  pores (N,): those with a
    strength. Of wrinkles nodes (W, 2), step (W, 3), length (W,), weight (W,).  seams: how many of
    them join pores on two sides of a UV seam."""

    points: Points
    pores: BoolArray
    nodes: NDArray[np.int32]
    step: FloatArray
    length: FloatArray
    weight: FloatArray
    seams: int


def _net(mesh: Mesh, surface: Surface, graph: WrinkleGraph) -> _Net:
    if graph.node_triangle is None:
        raise GraphError("node_triangle is missing: statistics need the triangle of every pore")
    rows, nodes = whole_wrinkles(mesh, graph)
    # A half, or an original across a seam, ends at a node that is no pore.
    ends = graph.edge_nodes[rows]
    seams = int(np.count_nonzero((ends != nodes).any(axis=1)))
    placed = (graph.node_triangle >= 0) & graph.own_nodes
    shown = (graph.edge_weight[rows] > 0) & placed[nodes].all(axis=1)
    nodes, weight = (
        (np.cumsum(placed, dtype=np.int32) - np.int32(1))[nodes[shown]],
        graph.edge_weight[rows[shown]].astype(np.float64),
    )
    points = _points(surface, graph, np.flatnonzero(placed))
    step = points.position[nodes[:, 1]] - points.position[nodes[:, 0]]
    length, pores = np.linalg.norm(step, axis=-1), graph.pore_weight[placed] > 0
    return _Net(points, pores, nodes, step, length, weight, seams)


def _points(surface: Surface, graph: WrinkleGraph, nodes: IntArray) -> Points:
    """The points of nodes on the surface, with the normals of their triangles."""
    assert graph.node_triangle is not None
    triangle = graph.node_triangle[nodes].astype(np.int64)
    uv = graph.node_uv[nodes].astype(np.float64)
    normal = surface.normals[triangle].mean(axis=1)
    return Points(triangle, uv, surface.place(triangle, uv), normal)


def _moments(values: FloatArray) -> dict[str, float]:
    if not len(values):
        return {"mean": 0.0, "deviation": 0.0}
    return {"mean": float(values.mean()), "deviation": float(values.std())}


def _degrees(net: _Net) -> dict[str, Any]:
    degree = np.bincount(net.nodes.ravel(), minlength=len(net.points))[net.pores]
    mean = float(degree.mean()) if len(degree) else 0.0
    return {"mean": mean, "histogram": np.bincount(degree).tolist()}


def _angles(net: _Net) -> dict[str, Any]:
    """Angles of wrinkles to the level direction, in the tangent plane of the first node, mirrored
    into 0 to 90 degrees: counts and mean weights by tens of degrees."""
    count, total = np.zeros(ANGLES, np.int64), np.zeros(ANGLES)
    for rows in row_blocks(len(net.nodes)):
        step = net.step[rows]
        normal = net.points.normal[net.nodes[rows, 0]].astype(np.float64)
        level = level_directions(normal)
        along = np.abs(np.einsum("nx,nx->n", step, level))
        across = np.abs(np.einsum("nx,nx->n", step, np.cross(normal, level)))
        angle = np.degrees(np.arctan2(across, along))
        bins = np.minimum((angle * (ANGLES / 90.0)).astype(np.int64), ANGLES - 1)
        count += np.bincount(bins, minlength=ANGLES)
        total += np.bincount(bins, weights=net.weight[rows], minlength=ANGLES)
    means = np.round(total / np.maximum(count, 1), 6).tolist()
    return {"angles": count.tolist(), "angle_strengths": means}
