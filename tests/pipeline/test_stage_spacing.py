"""The mean distance of pores, from which a depth is chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.mesh import Mesh
from rhytid.engine.assets.graphs import mean_spacing
from rhytid.pipeline.locate import locate_points
from rhytid.synthesis.generate import synthesize
from synthesis import sheets

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def square(size):
    return Mesh(np.pad(SQUARE * size, ((0, 0), (0, 1))), FACES, SQUARE, FACES)


def pores_at(*places):
    uv = np.array(places, np.float32)
    zeros, ones = np.zeros(len(uv), np.float32), np.full(len(uv), 0.01, np.float32)
    graph = random_graph(1, 1)
    return replace(
        graph, node_uv=uv, node_weight=zeros, node_radius=ones, edge_nodes=np.zeros((0, 2), int),
        edge_weight=zeros[:0], edge_half_width=zeros[:0],
    )  # fmt: skip


def spacing(size, *places):
    return mean_spacing(square(size), pores_at(*places), np.zeros(len(places), np.int32))


def test_pores_that_coincide_count_as_one():
    apart = [(0.5, 0.25), (0.75, 0.25), (0.75, 0.5)]
    assert spacing(2.0, *apart) == pytest.approx(0.5)
    assert spacing(2.0, *apart, *apart) == pytest.approx(0.5)


def test_pores_that_all_coincide_leave_the_mean_edge():
    place = (0.75, 0.25)
    edges = (4 * 1.0 + 2 * np.sqrt(2)) / 6
    assert spacing(3.0, place, place, place) == pytest.approx(3 * edges)
    assert spacing(3.0, place) == pytest.approx(3 * edges)


def test_the_smallest_meshes_have_a_depth_that_settings_take():
    found = 0.15 * spacing(1e-9, (0.5, 0.25), (0.5001, 0.25))
    assert found == pytest.approx(1.5e-14, rel=1e-2)
    assert settings_of(depth=found).depth == found


def test_pores_off_the_mesh_are_left_out(device):
    mesh, graph = sheet(), random_graph(2, 40)
    triangle = locate_points(device, mesh, graph.node_uv, 256, 0)
    off = triangle == len(mesh.faces)
    assert off.any()
    there = mean_spacing(mesh, pores_at(*graph.node_uv[~off]), triangle[~off])
    assert mean_spacing(mesh, graph, triangle) == there


@pytest.mark.parametrize("make", [sheets.sheet, sheets.tube])
def test_a_graph_from_elsewhere_has_the_spacing_that_it_was_grown_with(device, make):
    mesh = make()
    # In patches pores are denser and sparser, and more of them stand where they are dense.
    found = synthesize(mesh, replace(sheets.wanted(6000), patches=0.0), device)
    triangle = found.graph.node_triangle
    # It was grown with the mean of even skin, of which one mesh is a sample.
    assert mean_spacing(mesh, found.graph, triangle) == pytest.approx(found.spacing, rel=5e-3)
