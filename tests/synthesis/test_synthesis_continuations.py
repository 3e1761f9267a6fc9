"""Wrinkles that continue one another, against the same found one by one in double."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.seams import seam_halves
from rhytid.synthesis.continuations import ALONE, LEAST_COSINE, ON_OTHERS
from rhytid.synthesis.generate import synthesize
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


def test_lines_go_straight_over_seams(device):
    mesh = sheets.tube()
    graph = synthesize(mesh, sheets.wanted(2000), device).graph
    one, two = seam_halves(mesh, graph).T
    assert len(one) > 20
    np.testing.assert_array_equal(graph.edge_partners[one, 1], two)
    np.testing.assert_array_equal(graph.edge_partners[two, 1], one)
    np.testing.assert_array_equal(graph.edge_slopes[[one, two], 1], 0.0)
    np.testing.assert_allclose(graph.edge_end_weights[one, 1], graph.edge_end_weights[two, 1])
    # At its own pore a half goes on like any other line.
    assert (graph.edge_partners[np.concatenate([one, two]), 0] >= 0).mean() > 0.5
    back = graph.edge_partners[graph.edge_partners]
    rows = np.arange(graph.wrinkles)[:, None, None]
    assert ((back == rows).any(-1) | (graph.edge_partners < 0)).all()
