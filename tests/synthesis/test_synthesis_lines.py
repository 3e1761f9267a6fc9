"""Wrinkles that continue one another, against the same found one by one in double."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.test_stage_seams import folded
from rhytid.domain.asset_settings import GraphSettings
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lines import ALONE, LEAST_COSINE, ON_OTHERS
from synthesis import sheets


@pytest.fixture(scope="module")
def flat(device):
    return synthesize(sheets.sheet(), GraphSettings(wrinkles=1500), device).graph


def pairs_at(graph, node):
    """Ends (wrinkle, 0 or 1) at a node by twos, the best first: greedy, in the map of a flat sheet
    that is square there."""
    ends = [tuple(map(int, at)) for at in np.argwhere(graph.edge_nodes == node)]
    uv = graph.node_uv.astype(np.float64)
    ways = [uv[graph.edge_nodes[i, 1 - k]] - uv[graph.edge_nodes[i, k]] for i, k in ends]
    unit = np.array([way / np.linalg.norm(way) for way in ways])
    found, free = [], set(range(len(ends)))
    while True:
        choices = [
            (min(graph.edge_weight[ends[i][0]], graph.edge_weight[ends[j][0]]) * c * c, i, j)
            for i in free
            for j in free
            if i < j and (c := -unit[i] @ unit[j]) >= LEAST_COSINE
        ]
        if not choices:
            return ends, found, unit
        _, i, j = max(choices)
        free -= {i, j}
        found.append((i, j))


def test_partners_are_those_found_one_by_one_and_share_a_tangent(flat):
    graph, bends, met = flat, 0, 0
    for node in range(graph.pores):
        ends, pairs, unit = pairs_at(graph, node)
        partner = {ends[i]: ends[j][0] for i, j in pairs} | {ends[j]: ends[i][0] for i, j in pairs}
        for end in ends:
            assert graph.edge_partners[end] == partner.get(end, -1)
            if end not in partner:
                assert graph.edge_slopes[end] == 0.0
                share = ON_OTHERS if len(ends) > 1 else ALONE
                own = graph.edge_weight[end[0]], graph.edge_half_width[end[0]]
                assert graph.edge_end_weights[end] == pytest.approx(share[0] * own[0], rel=1e-5)
                assert graph.edge_end_half_widths[end] == pytest.approx(share[1] * own[1], rel=1e-5)
        for i, j in pairs:
            tangent = [turned(unit[k], graph.edge_slopes[ends[k]]) for k in (i, j)]
            np.testing.assert_allclose(tangent[0], -tangent[1], atol=1e-4)
            bends += abs(graph.edge_slopes[ends[i]]) > 0.05
            mean = graph.edge_weight[[ends[i][0], ends[j][0]]].mean()
            for k in (i, j):
                assert graph.edge_end_weights[ends[k]] == pytest.approx(mean, rel=1e-5)
            met += 1
    assert met > 600
    assert bends > 200


def turned(way, slope):
    """A direction away from its pore, with dy/dx of its arc there."""
    tangent = way + slope * np.array([-way[1], way[0]])
    return tangent / np.linalg.norm(tangent)


def test_half_widths_are_means_on_the_surface(flat):
    one, end = np.argwhere(flat.edge_partners >= 0)[::7].T
    two = flat.edge_partners[one, end]
    mean = 0.5 * (flat.edge_half_width[one] + flat.edge_half_width[two])  # UV is even here
    np.testing.assert_allclose(flat.edge_end_half_widths[one, end], mean, rtol=1e-3)


def unfolded(mirrored):
    """The sheet of two charts, laid flat, so that lines go over its seam."""
    mesh = folded(mirrored=mirrored)
    x, y, z = mesh.positions.T
    return replace(mesh, positions=np.stack([x + z, y, 0 * z], axis=1))


@pytest.mark.parametrize(
    "mesh",
    [sheets.tube(), unfolded(False), unfolded(True)],
    ids=["tube", "turned", "mirrored"],
)
def test_lines_go_on_over_seams(device, mesh):
    """Where a line over a seam goes on at its far pore, the copy of it and the line there share a
    tangent in the UV of that pore."""
    graph = synthesize(mesh, sheets.wanted(2000), device).graph
    partners, copy_of = graph.edge_partners, graph.edge_copy_of
    own = np.flatnonzero(graph.own_edges)
    back = partners[np.maximum(partners[own], 0)]
    assert ((back == own[:, None, None]).any(-1) | (partners[own] < 0)).all()
    copies = np.flatnonzero(copy_of >= 0)
    np.testing.assert_array_equal(partners[copies], partners[copy_of[copies]])
    weights, widths = graph.edge_end_weights, graph.edge_end_half_widths
    np.testing.assert_array_equal(weights[copies], weights[copy_of[copies]])
    ratio = widths / graph.edge_half_width[:, None]
    np.testing.assert_allclose(ratio[copies], ratio[copy_of[copies]], rtol=1e-5)
    turns = []
    for copy in copies:
        first = copy_of[copy]
        far = graph.original_nodes(graph.edge_nodes[first])[1]
        end = graph.node_uv[graph.edge_nodes[copy, 1]]
        other = partners[first, 1]
        if far == graph.edge_nodes[first, 1] or other < 0:
            continue  # it ends on its own chart, or there
        if np.abs(end - graph.node_uv[far]).max() > 1e-3 or far not in graph.edge_nodes[other]:
            continue  # the copy is of another chart, or the other goes on over the seam as well
        at = int(graph.edge_nodes[other, 1] == far)
        one, two = tangent(graph, copy, 1), tangent(graph, other, at)
        turns.append(np.degrees(np.arccos(np.clip(-one @ two, -1.0, 1.0))))
    assert len(turns) > 20
    assert np.percentile(turns, 90) < 0.01  # but where a slope is the steepest


def tangent(graph, row, end):
    """(2,) of unit length, away from a node into a line, in UV."""
    ends = graph.node_uv[graph.edge_nodes[row]].astype(np.float64)
    metric = graph.edge_metric[row].astype(np.float64)
    root = np.eye(2)
    if metric.any():
        root = np.linalg.cholesky(metric[[0, 1, 1, 2]].reshape(2, 2)).T
    way = root @ (ends[1 - end] - ends[end])
    there = np.linalg.solve(root, turned(way / np.linalg.norm(way), graph.edge_slopes[row, end]))
    return there / np.linalg.norm(there)


def test_how_many_pores_are_paired_at_a_time_changes_no_bit(device, monkeypatch):
    mesh, settings = folded(), GraphSettings(wrinkles=1500)
    whole = synthesize(mesh, settings, device).graph.arrays()
    monkeypatch.setattr("rhytid.synthesis.lines._PORES", 100)
    parts = synthesize(mesh, settings, device).graph.arrays()
    assert (whole["edge_partners"] >= 0).mean() > 0.3
    for name, array in whole.items():
        assert array.tobytes() == parts[name].tobytes(), name
