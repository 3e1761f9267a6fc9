"""What is drawn in which UDIM and listed for which block, and the bins of orientation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.scenes import random_graph, settings_of
from reference import bins, drawing, redraw
from reference.response import scales
from rhytid.domain.tiles import udim_origin
from rhytid.errors import LimitError
from rhytid.pipeline import reach
from rhytid.pipeline.element_arrays import check_cover, pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import orientation_bins
from rhytid.pipeline.reach import widest
from rhytid.pipeline.work import BLOCK

UDIMS = (1001, 1002, 1011, 1012)
NARROW = {"alpha_w": 0.5, "beta_w": 0.7}


def listed(lists, resolution):
    """(blocks, K) whether an element is listed for a block."""
    members = np.split(lists.members, lists.offsets[1:-1])
    assert all((np.diff(m) > 0).all() for m in members)
    flags = np.zeros(((resolution // BLOCK) ** 2, lists.members.max(initial=0) + 1), bool)
    for block, found in enumerate(members):
        flags[block, found] = True
    return flags


def texel_blocks(resolution):
    """Texel centres (R², 2) local to the UDIM and the block (R²,) of each."""
    points = drawing.crop(0, 0, resolution, resolution, resolution)
    row, column = np.divmod(np.arange(resolution**2), resolution)
    return points, (row // BLOCK) * (resolution // BLOCK) + column // BLOCK


@pytest.mark.parametrize("response", [{}, NARROW], ids=["default", "narrow"])
@pytest.mark.parametrize("udim", UDIMS)
def test_every_wrinkle_is_listed_where_it_can_reach(udim, response):
    graph = random_graph(1, span=2.0)
    settings = settings_of(response=response)
    reach = widest_scale(settings.response.alpha_w)
    arrays = wrinkle_arrays(graph, np.arange(graph.wrinkles, dtype=np.int32), settings, udim)
    flags = listed(arrays.lists, settings.resolution)
    points, block = texel_blocks(settings.resolution)
    lines = redraw.wrinkles(graph, reach, origin=udim_origin(udim))
    for i in range(graph.wrinkles):
        inside = drawing.segment_distance(points, *lines.segments[i]) < lines.half_width[i]
        place = np.flatnonzero(arrays.triangle == i)
        reached = np.unique(block[inside])
        assert not len(reached) or (len(place) == 1 and flags[reached, place[0]].all())


@pytest.mark.parametrize("metric", [False, True])
@pytest.mark.parametrize("udim", UDIMS)
def test_every_pore_is_listed_where_it_can_reach(udim, metric):
    graph = random_graph(2, 120, span=2.0, metric=metric)
    settings = settings_of(response=NARROW)
    arrays = pore_arrays(graph, np.arange(graph.pores, dtype=np.int32), settings, udim)
    flags = listed(arrays.lists, settings.resolution)
    points, block = texel_blocks(settings.resolution)
    discs = redraw.pores(graph, widest_scale(settings.response.beta_w), origin=udim_origin(udim))
    for i in range(graph.pores):
        inside = drawing.metric_distance(points, discs.centres[i], discs.metric[i]) < 1
        place = np.flatnonzero(arrays.triangle == i)
        reached = np.unique(block[inside])
        assert not len(reached) or (len(place) == 1 and flags[reached, place[0]].all())


def widest_scale(exponent, limit=0.5):
    return scales(limit, exponent, 0.0)[0]


@given(st.floats(0, 64), st.floats(0.01, 4), st.floats(-1, 1))
def test_no_stretch_within_the_limit_makes_wider_than_widest(exponent, limit, share):
    assert scales(share * limit, exponent, 0.0)[0] * (1 + 1e-5) <= widest(exponent, limit)


def test_what_has_no_strength_is_not_drawn():
    graph = random_graph(3)
    weights = graph.edge_weight.copy(), graph.node_weight.copy()
    for weight in weights:
        weight[::2] = 0.0
    graph = replace(graph, edge_weight=weights[0], node_weight=weights[1])
    lines = wrinkle_arrays(graph, np.arange(80, dtype=np.int32), settings_of(), 1001)
    discs = pore_arrays(graph, np.arange(160, dtype=np.int32), settings_of(), 1001)
    assert set(lines.triangle % 2) == {1}
    assert set(discs.triangle % 2) == {1}


def test_elements_keep_their_own_triangle_size_and_strength():
    graph, settings = random_graph(4, metric=True), settings_of()
    lines = wrinkle_arrays(graph, np.arange(80, dtype=np.int32), settings, 1001)
    ends = graph.node_uv[graph.edge_nodes[lines.triangle]] * 256
    np.testing.assert_array_equal(lines.segments[:, :2], ends[:, 0])
    np.testing.assert_allclose(lines.segments[:, 2:], ends[:, 1] - ends[:, 0], atol=1e-4)
    np.testing.assert_array_equal(lines.sizes[:, 0], 256 * graph.edge_half_width[lines.triangle])
    np.testing.assert_array_equal(lines.sizes[:, 1], graph.edge_weight[lines.triangle])
    discs = pore_arrays(graph, np.arange(160, dtype=np.int32), settings, 1001)
    np.testing.assert_array_equal(discs.centres, 256 * graph.node_uv[discs.triangle])
    xx, xy, yy, weight = discs.roots.T * [[256], [256], [256], [1]]
    metric = np.stack([xx * xx, xx * xy, xy * xy + yy * yy], axis=1)
    np.testing.assert_allclose(metric, graph.node_metric[discs.triangle], rtol=1e-5)
    np.testing.assert_array_equal(weight, graph.node_weight[discs.triangle])


def test_more_cover_than_the_map_can_hold_is_refused(monkeypatch):
    monkeypatch.setattr(reach, "_MOST_COVER", 0.5)
    graph = random_graph(5)
    with pytest.raises(LimitError, match=r"the wrinkles cover \d+ times the map of UDIM 1001"):
        wrinkle_arrays(graph, np.zeros(80, np.int32), settings_of(), 1001)
    with pytest.raises(LimitError, match=r"the pores cover \d+ times the map of UDIM 1001"):
        pore_arrays(graph, np.zeros(160, np.int32), settings_of(), 1001)
    with pytest.raises(
        LimitError, match=r"the graph's wrinkles cover \d+ times the map of UDIM 1001"
    ):
        check_cover(graph, settings_of(), 1001)
    with pytest.raises(LimitError, match=r"the graph's pores cover \d+ times the map of UDIM 1001"):
        check_cover(replace(graph, edge_weight=0 * graph.edge_weight), settings_of(), 1001)
    check_cover(graph, settings_of(), 1002)  # of which the graph has no part


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16])
def test_orientation_bins_are_those_of_the_reference(count):
    angle = np.random.default_rng(6).uniform(0, 2 * np.pi, 4000)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    wanted, margin = bins.assign(along, count)
    sure = margin > 1e-6
    found = orientation_bins(np.concatenate([np.zeros_like(along), along], axis=1), count)
    np.testing.assert_array_equal(found[sure], wanted[sure])
    assert sure.mean() > 0.99


def test_a_bin_does_not_depend_on_the_sense_of_a_wrinkle():
    angle = np.random.default_rng(7).uniform(0, np.pi, 4000)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    sure = bins.assign(along, 4)[1] > 1e-6
    both = [orientation_bins(np.concatenate([0 * e, e], axis=1), 4)[sure] for e in (along, -along)]
    np.testing.assert_array_equal(*both)
