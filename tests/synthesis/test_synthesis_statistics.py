"""Figures of graphs, of synthesised ones and of some small enough to count by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import GraphError
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.statistics import statistics
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.sheets import wanted

PLACES = [[1, 2], [3, 2], [2, 1], [2, 3], [2.5, 0.5], [3.5, 1.5], [0.5, 3.5]]


@pytest.fixture(scope="module")
def made(device: Device) -> Synthesis:
    return synthesize(sheets.sheet(sheets.uneven), replace(wanted(3000), patches=0.0), device)


def test_figures_of_a_synthesis_are_plain_and_right(device: Device, made: Synthesis) -> None:
    figures = statistics(sheets.sheet(sheets.uneven), made.graph, device)
    assert json.loads(json.dumps(figures)) == figures
    assert figures["wrinkles"] == sum(figures["strengths"]) == sum(figures["angles"]) == 3000
    assert figures["pores"] == sum(figures["degree"]["histogram"]) == made.graph.pores
    at = sheets.places(Surface.of(sheets.sheet(sheets.uneven)), made.graph)
    nearest = cKDTree(at).query(at, k=2)[0][:, 1]
    assert figures["distance"]["mean"] == pytest.approx(nearest.mean(), rel=1e-5)
    assert made.spacing == pytest.approx(nearest.mean(), rel=0.01)
    assert figures["degree"]["mean"] == pytest.approx(6000 / made.graph.pores)
    assert figures["length"]["mean"] > figures["distance"]["mean"]
    assert figures["crossings"] < 0.001
    assert (figures["drawn_pores"], figures["drawn_wrinkles"]) == (made.graph.pores, 3000)
    assert figures["seam_wrinkles"] == 0


def cross(**changes: object) -> tuple[Mesh, WrinkleGraph]:
    """On the square of side 4 facing +z, y up: one wrinkle to the right, one up, which cross; one
    at 45 degrees beside them; a pore that none touches."""
    mesh = sheets.sheet(lambda xy: 0.9 * xy, n=4, scale=4.0)
    values = {
        "node_uv": np.array(PLACES) * 0.9 / 4, "node_weight": np.full(7, 0.5),
        "node_radius": np.full(7, 0.01), "edge_nodes": [[0, 1], [3, 2], [4, 5]],
        "edge_weight": [0.25, 0.65, 1.0], "edge_half_width": np.full(3, 0.01),
    }  # fmt: skip
    graph = WrinkleGraph(**{**values, **changes})
    corners = mesh.triangle_uv()
    inside = [_holds(corners, uv) for uv in graph.node_uv.astype(float)]
    return mesh, replace(graph, node_triangle=np.array(inside, np.int32))


def _holds(corners: np.ndarray, uv: np.ndarray) -> int:
    a, b, c = np.moveaxis(corners, 1, 0)
    sides = [
        (q - p)[:, 0] * (uv - p)[:, 1] - (q - p)[:, 1] * (uv - p)[:, 0]
        for p, q in ((a, b), (b, c), (c, a))
    ]
    return int(np.flatnonzero((np.array(sides) >= -1e-6).all(axis=0))[0])


def test_a_graph_that_can_be_counted_by_hand(device: Device) -> None:
    figures = statistics(*cross(), device)
    assert (figures["pores"], figures["wrinkles"]) == (7, 3)
    assert figures["degree"] == {"mean": pytest.approx(6 / 7), "histogram": [1, 6]}
    assert figures["crossings"] == pytest.approx(1 / 3)
    assert figures["strengths"] == [0, 0, 1, 0, 0, 0, 1, 0, 0, 1]
    lengths = [2, 2, np.sqrt(2)]
    assert figures["length"]["mean"] == pytest.approx(np.mean(lengths))
    assert figures["length"]["deviation"] == pytest.approx(np.std(lengths))
    assert figures["angles"] == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert figures["angle_strengths"] == [0.25, 0, 0, 0, 1.0, 0, 0, 0, 0.65]
    place = np.array(PLACES)
    apart = np.linalg.norm(place[:, None] - place, axis=-1) + 99 * np.eye(7)
    assert figures["distance"]["mean"] == pytest.approx(apart.min(axis=1).mean())


def test_wrinkles_are_looked_at_in_blocks(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than fit into a block, some of them not drawn: the figures are those of all at once."""
    mesh = sheets.sheet(sheets.uneven)
    graph = synthesize(mesh, replace(wanted(140_000), patches=0.0), device).graph
    drawn = np.arange(graph.wrinkles) % 7 > 0
    graph = replace(graph, edge_weight=graph.edge_weight * drawn)
    monkeypatch.setattr("rhytid.synthesis.progress.ROWS", 1 << 16)
    figures = statistics(mesh, graph, device)
    nodes, weight = graph.edge_nodes[drawn], graph.edge_weight[drawn].astype(np.float64)
    step = np.diff(sheets.places(Surface.of(mesh), graph)[nodes], axis=1)[:, 0]
    length = np.linalg.norm(step, axis=1)
    assert figures["length"]["mean"] == pytest.approx(length.mean(), rel=1e-9)
    assert figures["length"]["deviation"] == pytest.approx(length.std(), rel=1e-9)
    assert figures["strengths"] == np.histogram(weight, 10, (0.0, 1.0))[0].tolist()
    degree = np.bincount(nodes.ravel(), minlength=graph.pores)
    assert figures["degree"]["histogram"] == np.bincount(degree).tolist()
    assert sum(figures["angles"]) == figures["drawn_wrinkles"] == len(nodes)
    shares = np.array(figures["angles"]) * figures["angle_strengths"]
    assert shares.sum() == pytest.approx(weight.sum(), rel=1e-5)


def test_what_is_not_drawn_counts_for_itself(device: Device) -> None:
    weight = np.array([0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0])
    figures = statistics(*cross(node_weight=weight, edge_weight=[0.25, 0.0, 1.0]), device)
    assert (figures["pores"], figures["drawn_pores"]) == (7, 6)
    assert (figures["wrinkles"], figures["drawn_wrinkles"]) == (3, 2)
    assert figures["degree"] == {"mean": pytest.approx(4 / 6), "histogram": [2, 4]}
    assert figures["crossings"] == 0
    assert sum(figures["angles"]) == sum(figures["strengths"]) == 2


def test_wrinkles_without_pores_are_wrinkles(device: Device) -> None:
    figures = statistics(*cross(node_weight=np.zeros(7)), device)
    assert figures["drawn_pores"] == 0
    assert figures["angles"] == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert figures["degree"] == {"mean": 0.0, "histogram": []}
    assert figures["distance"] == {"mean": 0.0, "deviation": 0.0}


def test_nodes_on_no_triangle_are_left_out(device: Device) -> None:
    mesh, graph = cross()
    triangle = graph.node_triangle.copy()
    triangle[[5, 6]] = -1
    figures = statistics(mesh, replace(graph, node_triangle=triangle), device)
    assert figures["angles"] == [1, 0, 0, 0, 0, 0, 0, 0, 1]
    assert sum(figures["degree"]["histogram"]) == 5


def test_a_wrinkle_across_a_seam_counts_once(device: Device) -> None:
    mesh = sheets.tube()
    graph = synthesize(mesh, wanted(2000), device).graph
    figures = statistics(mesh, graph, device)
    assert figures["seam_wrinkles"] > 20
    assert figures["wrinkles"] == figures["drawn_wrinkles"] == sum(figures["angles"]) == 2000
    assert figures["copied_wrinkles"] == graph.wrinkles - 2000 > figures["seam_wrinkles"]
    assert figures["pores"] == figures["drawn_pores"] == sum(figures["degree"]["histogram"])
    assert figures["drawn_pores"] + figures["copied_pores"] == np.count_nonzero(graph.node_weight)
    assert figures["degree"]["mean"] == pytest.approx(4000 / figures["pores"])
    assert graph.figures()["degree"] == pytest.approx(4000 / figures["pores"])
    assert sum(graph.figures()["strengths"]) == 2000
    # Its ends are the pores of both sides: no wrinkle is half as long as it is.
    assert figures["length"]["deviation"] < 0.3 * figures["length"]["mean"]


def test_they_need_the_triangles_of_pores(device: Device, made: Synthesis) -> None:
    arrays = made.graph.arrays()
    del arrays["node_triangle"]
    with pytest.raises(GraphError, match="node_triangle"):
        statistics(sheets.sheet(sheets.uneven), WrinkleGraph(**arrays), device)
