"""Figures of a wrinkle graph on its mesh, and how far its pores stand apart. Kernel: nearest.cl."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
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
from rhytid.synthesis.lattice import DevicePoints, bounds
from rhytid.synthesis.progress import masked, over_rows, row_blocks, together
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface
from rhytid.synthesis.workspace import Workspace

STRENGTHS = 10  # tenths from 0 to 1
ANGLES = 9  # of ten degrees, from 0 to 90
# The first look goes so far, in spacings that the points would have on a flat square of area 1;
# those that find nothing look on twice as far.
_FIRST = 2.0
# Wrinkles that are counted at pores at a time.
_AT_ENDS = 1 << 14


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
    figures = _figures(surface, graph, net)
    every = vars(net.points)
    pores = Points(**dict(zip(every, masked(net.pores, *every.values()), strict=True)))
    length, count = net.length.astype(np.float32), max(len(net.nodes), 1)
    points, nodes = net.points, net.nodes
    del net  # it may be large, and so is what is put on the device
    with Workspace(device) as work:
        mean, deviation = mean_spacing(work, pores)
        del pores
        crossing = len(crossings(work, points, nodes, length))
    distance = {"mean": mean * surface.scale, "deviation": deviation * surface.scale}
    return figures | {"distance": distance, "crossings": crossing / count}


def _figures(surface: Surface, graph: WrinkleGraph, net: _Net) -> dict[str, Any]:
    """The figures in their order, without those that are found on the device. Most are sums in an
    order, of one core each: they are found side by side."""
    counts, length, degree, strengths, angles = together(
        partial(_counts, graph, net.seams),
        partial(_moments, net.length, surface.scale),
        partial(_degrees, net),
        partial(_strengths, net.weight),
        partial(_angles, surface, net),
    )
    return {
        **counts,
        "distance": None,
        "length": length,
        "degree": degree,
        "crossings": None,
        "strengths": strengths.tolist(),
        **angles,
    }


def _counts(graph: WrinkleGraph, seams: int) -> dict[str, Any]:
    """Figures of the graph alone, and how many wrinkles join pores on two sides of a seam."""
    pores, wrinkles = graph.counts()
    return {
        "pores": pores,
        "drawn_pores": int(np.count_nonzero(graph.pore_weight[graph.own_nodes])),
        "copied_pores": int(np.count_nonzero(graph.pore_weight[~graph.own_nodes])),
        "wrinkles": wrinkles,
        "drawn_wrinkles": int(np.count_nonzero(graph.edge_weight[graph.own_edges])),
        "copied_wrinkles": graph.wrinkles - wrinkles,
        "seam_wrinkles": seams,
        "events": graph.event_counts(),
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
    low, high = bounds(pores.position)
    extent = float((high - low).max())
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
    nearest2 = work.readable(len(asked), np.float32)
    work.run(
        "nearest", "nearest_distance", len(asked), work.lend(asked), *cloud.points,
        *cloud.grid.arguments, float(cloud.lattice.unit / cell), nearest2, defines=DEFINES,
    )  # fmt: skip
    found = work.read(nearest2, (len(asked),), np.float32)
    distances: NDArray[np.float32] = np.float32(cell) * np.sqrt(found)
    return distances


@dataclass(frozen=True, eq=False)
class _Net:
    """The drawn part of a graph.  points (N,): the nodes on the surface.  pores (N,): those with a
    strength. Of wrinkles nodes (W, 2), length (W,), weight (W,).  seams: how many of them join
    pores on two sides of a UV seam."""

    points: Points
    pores: BoolArray
    nodes: NDArray[np.int32]
    length: FloatArray
    weight: NDArray[np.float32]
    seams: int


def _net(mesh: Mesh, surface: Surface, graph: WrinkleGraph) -> _Net:
    if graph.node_triangle is None:
        raise GraphError("node_triangle is missing: statistics need the triangle of every pore")
    rows, nodes = whole_wrinkles(mesh, graph)
    placed = (graph.node_triangle >= 0) & graph.own_nodes
    seam, shown = np.empty(len(rows), np.bool_), np.empty(len(rows), np.bool_)

    def look(some: slice) -> None:
        # A half, or an original across a seam, ends at a node that is no pore.
        seam[some] = (graph.edge_nodes[rows[some]] != nodes[some]).any(axis=1)
        shown[some] = (graph.edge_weight[rows[some]] > 0) & placed[nodes[some]].all(axis=1)

    over_rows(len(rows), look)
    rows, nodes = masked(shown, rows, nodes)
    points = _points(surface, graph, np.flatnonzero(placed))
    number = np.cumsum(placed, dtype=np.int32)
    length = np.empty(len(nodes))

    def measure(some: slice) -> None:
        nodes[some] = number[nodes[some]] - np.int32(1)
        one, two = nodes[some].T
        length[some] = np.linalg.norm(points.position[two] - points.position[one], axis=-1)

    over_rows(len(nodes), measure)
    pores, seams = graph.pore_weight[placed] > 0, int(np.count_nonzero(seam))
    return _Net(points, pores, nodes, length, graph.edge_weight[rows], seams)


def _points(surface: Surface, graph: WrinkleGraph, nodes: IntArray) -> Points:
    """The points of nodes on the surface, with the normals of their triangles."""
    assert graph.node_triangle is not None
    triangle, uv = graph.node_triangle[nodes], graph.node_uv[nodes]
    position, normal = np.empty((len(nodes), 3)), np.empty((len(nodes), 3), np.float32)
    facing = surface.normals.mean(axis=1)

    def find(rows: slice) -> None:
        position[rows] = surface.place(triangle[rows], uv[rows].astype(np.float64))
        normal[rows] = facing[triangle[rows]]

    over_rows(len(nodes), find)
    return Points(triangle, uv, position, normal)


def _strengths(weight: NDArray[np.float32]) -> IntArray:
    """(STRENGTHS,) how many weights there are in each tenth. In double: a tenth is between two
    singles."""
    count = np.zeros(STRENGTHS, np.int64)
    for rows in row_blocks(len(weight)):
        count += np.histogram(weight[rows].astype(np.float64), STRENGTHS, (0.0, 1.0))[0]
    return count


def _moments(values: FloatArray, scale: float) -> dict[str, float]:
    """Mean and deviation of values times a power of two, which rounds nothing."""
    if not len(values):
        return {"mean": 0.0, "deviation": 0.0}
    return {"mean": float(values.mean()) * scale, "deviation": float(values.std()) * scale}


def _degrees(net: _Net) -> dict[str, Any]:
    ends = np.zeros((2, len(net.points)), np.int32)

    def count(side: slice) -> None:
        for rows in row_blocks(len(net.nodes), _AT_ENDS):
            np.add.at(ends[side.start], net.nodes[rows, side.start], 1)

    over_rows(2, count, each=1)
    degree = (ends[0] + ends[1])[net.pores]
    mean = float(degree.mean()) if len(degree) else 0.0
    return {"mean": mean, "histogram": np.bincount(degree).tolist()}


def _angles(surface: Surface, net: _Net) -> dict[str, Any]:
    """Angles of wrinkles to the level direction, in the tangent plane of the first node, mirrored
    into 0 to 90 degrees: counts and mean weights by tens of degrees."""
    bins, position = np.empty(len(net.nodes), np.uint8), net.points.position
    facing = surface.normals.mean(axis=1)

    def find(rows: slice) -> None:
        one, two = net.nodes[rows].T
        step = position[two] - position[one]
        normal = facing[net.points.triangle[one]]
        level = level_directions(normal)
        along = np.abs(np.einsum("nx,nx->n", step, level))
        across = np.abs(np.einsum("nx,nx->n", step, np.cross(normal, level)))
        angle = np.degrees(np.arctan2(across, along))
        bins[rows] = np.minimum((angle * (ANGLES / 90.0)).astype(np.int64), ANGLES - 1)

    over_rows(len(net.nodes), find)
    count, total = np.zeros(ANGLES, np.int64), np.zeros(ANGLES)
    for rows in row_blocks(len(bins)):
        count += np.bincount(bins[rows], minlength=ANGLES)
        total += np.bincount(bins[rows], weights=net.weight[rows], minlength=ANGLES)
    means = np.round(total / np.maximum(count, 1), 6).tolist()
    return {"angles": count.tolist(), "angle_strengths": means}
