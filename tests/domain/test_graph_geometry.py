"""A graph as lines in space: where they lie, how wide they are, and what happens at seams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import graph_curves, seam_halves, whole_wrinkles, with_triangles
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.shapes import NARROW, WIDE
from synthesis import sheets
from synthesis.halves import in_halves

EVEN = replace(sheets.wanted(2000), patches=0.0)


@pytest.fixture(scope="module")
def tube(device: Device) -> tuple[Mesh, WrinkleGraph]:
    mesh = sheets.tube()
    return mesh, synthesize(mesh, EVEN, device).graph


def square() -> Mesh:
    """Three by two in space, the unit square in UV."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(np.concatenate([corners * [3, 2], np.zeros((4, 1))], axis=1), faces, corners, faces)


def by_hand(**changes: object) -> WrinkleGraph:
    uv = np.array([[0.6, 0.2], [0.9, 0.2], [0.9, 0.6]], np.float32)
    values = {
        "node_uv": uv, "node_weight": np.ones(3), "node_radius": np.full(3, 0.01),
        "edge_nodes": [[0, 1], [2, 1]], "edge_weight": [0.25, 1.0],
        "edge_half_width": [0.02, 0.03], "node_triangle": np.zeros(3, int),
    }  # fmt: skip
    return WrinkleGraph(**{**values, **changes})


def test_lines_run_between_pores_and_widths_are_on_the_surface() -> None:
    curves = graph_curves(square(), by_hand())
    wanted = [[1.8, 0.4, 0], [2.7, 0.4, 0], [2.7, 1.2, 0]]
    np.testing.assert_allclose(curves.points, wanted, rtol=1e-6)
    np.testing.assert_array_equal(curves.lines, [[0, 1], [2, 1]])
    np.testing.assert_allclose(curves.widths, [2 * 0.02 * 2, 2 * 0.03 * 3], rtol=1e-6)
    np.testing.assert_allclose(curves.strengths, [0.25, 1.0])


def test_what_has_no_strength_or_no_triangle_is_left_out() -> None:
    faint = graph_curves(square(), by_hand(edge_weight=[0.0, 1.0]))
    assert (len(faint.points), faint.lines.tolist()) == (2, [[1, 0]])
    placed = with_triangles(by_hand(), np.array([2, 0, 0], np.int32), 2)
    assert graph_curves(square(), placed).lines.tolist() == [[1, 0]]
    with pytest.raises(GraphError, match="node_triangle is missing"):
        graph_curves(square(), by_hand(node_triangle=None))
    none = graph_curves(square(), by_hand(edge_weight=[0.0, 0.0]))
    assert (len(none.points), len(none.lines), len(none.widths)) == (0, 0, 0)


def test_a_wrinkle_across_a_seam_is_one_line(tube: tuple[Mesh, WrinkleGraph]) -> None:
    mesh, graph = tube
    curves = graph_curves(mesh, graph)
    assert graph.wrinkles - 2000 > 20
    assert len(curves.lines) == 2000
    assert len(curves.points) == np.count_nonzero(graph.own_nodes)
    ends = curves.points[curves.lines].astype(float)
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    # Pores evenly on a tube of radius 1: no line is longer than its neighbours', or leaves it.
    assert length.max() < 2.5 * np.median(length)
    np.testing.assert_allclose(np.hypot(ends[..., 0], ends[..., 2]), 1, atol=0.02)


def test_a_graph_of_halves_is_the_same_lines(tube: tuple[Mesh, WrinkleGraph]) -> None:
    mesh, graph = tube
    halves = in_halves(graph)
    assert len(seam_halves(mesh, halves)) == halves.wrinkles - 2000 > 20
    assert len(seam_halves(mesh, graph)) == 0
    lines, wanted = (graph_curves(mesh, g) for g in (halves, graph))
    np.testing.assert_array_equal(lines.points[lines.lines], wanted.points[wanted.lines])


def test_widths_are_those_that_synthesis_meant(
    device: Device, tube: tuple[Mesh, WrinkleGraph]
) -> None:
    mesh, graph = tube
    spacing = synthesize(mesh, EVEN, device).spacing
    curves = graph_curves(mesh, graph)
    wanted = 2 * spacing * (NARROW + (WIDE - NARROW) * curves.strengths)
    np.testing.assert_allclose(curves.widths, wanted, rtol=1e-3)


def test_halves_in_a_row_are_paired_from_the_first(tube: tuple[Mesh, WrinkleGraph]) -> None:
    mesh, graph = tube[0], in_halves(tube[1])
    one = seam_halves(mesh, graph)[0]
    rows = np.array([*one, *one, *one, one[0]])
    again = replace(
        graph,
        **{name: getattr(graph, name)[rows] for name in graph.arrays() if "edge" in name},
    )
    # Each copy needs a node beyond of its own.
    near, beyond = again.edge_nodes.T
    nodes = np.concatenate([near, beyond])
    own = {name: getattr(graph, name)[nodes] for name in graph.arrays() if "node_" in name}
    count = len(rows)
    edges = np.stack([np.arange(count), np.arange(count) + count], axis=1)
    alike = replace(again, **own, edge_nodes=edges)
    np.testing.assert_array_equal(seam_halves(mesh, alike), [[0, 1], [2, 3], [4, 5]])
    rows, ends = whole_wrinkles(mesh, alike)
    np.testing.assert_array_equal(rows, [0, 2, 4, 6])
    np.testing.assert_array_equal(ends, [[0, 1], [2, 3], [4, 5], [6, 6 + count]])


@pytest.mark.parametrize("change", ["weight", "shared", "strength", "order"])
def test_what_only_looks_like_halves_is_left_alone(
    tube: tuple[Mesh, WrinkleGraph], change: str
) -> None:
    mesh, graph = tube[0], in_halves(tube[1])
    whole = len(seam_halves(mesh, graph))
    first = seam_halves(mesh, graph)[3, 0]
    nodes, weight, strength = (
        getattr(graph, name).copy() for name in ("edge_nodes", "node_weight", "edge_weight")
    )
    if change == "weight":
        strength[first] *= 0.5
    elif change == "strength":
        weight[nodes[first, 1]] = 0.5
    elif change == "order":
        nodes[first] = nodes[first, ::-1]
    else:
        free = np.flatnonzero((graph.node_weight[nodes] > 0).all(axis=1))[0]
        nodes[free] = [nodes[free, 0], nodes[first, 1]]
    other = replace(graph, edge_nodes=nodes, node_weight=weight, edge_weight=strength)
    assert len(seam_halves(mesh, other)) == whole - 1
