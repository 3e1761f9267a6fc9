"""Chains of valley points, and the wrinkles along them."""

from __future__ import annotations

import numpy as np
import pytest

from reference import tracing as reference
from rhytid.domain.asset_settings import ShapeSettings
from rhytid.synthesis.workspace import Workspace
from rhytid.tracing import chains
from rhytid.tracing.elements import graph_arrays, lines_of, outside_pits, pores_of
from rhytid.tracing.ridges import Limits, find_ridges

SIDE = 192
PLAIN = ShapeSettings(cushion=0.0)


MIDDLE = 95.37


def points_of(device, relief):
    with Workspace(device) as work:
        everywhere = np.ones(relief.shape, np.bool_)
        return find_ridges(work, relief.astype(np.float32), everywhere, Limits(0.05))


def traced(device, relief, gap=0.0, shape=PLAIN):
    """Points, chains longer than the ends of lines are wide, and their wrinkles."""
    points, _ = points_of(device, relief)
    links = chains.linked(points, relief.shape)
    found = [c for c in chains.chains_of(chains.joined(points, links, gap)) if len(c) > 6]
    return points, found, lines_of(points, found, 1.0, shape)


def circle(radius=60.0, half_width=3.0):
    """A ring around the middle."""
    y, x = np.mgrid[:SIDE, :SIDE]
    away = np.abs(np.hypot(x - MIDDLE, y - MIDDLE) - radius)
    return -reference.line_profile(away / half_width, 1.0)


def test_a_ring_is_one_chain_that_keeps_to_it(device):
    _, found, lines = traced(device, circle())
    assert len(found) == 1
    away = np.hypot(lines.x - MIDDLE, lines.y - MIDDLE)
    assert away == pytest.approx(60.0, abs=0.25)
    assert lines.lengths().sum() == pytest.approx(2 * np.pi * 60, rel=0.03)


def test_arcs_bend_as_the_ring_does(device):
    _, _, lines = traced(device, circle(), shape=ShapeSettings())
    long = lines.lengths() > 6
    bend, half = np.abs(lines.slopes[long]), lines.lengths()[long, None] / 120
    assert bend == pytest.approx(np.repeat(half, 2, axis=1), abs=0.08)
    assert (np.sign(lines.slopes[long, 0]) == np.sign(lines.slopes[long, 0])[0]).all()
    # The middle of an arc, to the left of its chord with y up, lies on the ring.
    one, two = lines.edges[long].T
    middle = np.stack([lines.x[one] + lines.x[two], lines.y[one] + lines.y[two]], axis=1) / 2
    step = np.stack([lines.x[two] - lines.x[one], lines.y[two] - lines.y[one]], axis=1)
    left = np.stack([step[:, 1], -step[:, 0]], axis=1)
    top = middle + left * ((lines.slopes[long, :1] - lines.slopes[long, 1:]) / 8)
    assert np.hypot(*(top - MIDDLE).T) == pytest.approx(60.0, abs=0.3)


def test_a_line_goes_on_over_a_gap(device):
    lines = np.array([[20.0, 60.0, 90.0, 80.0], [100.0, 82.86, 170.0, 102.86]])
    relief = reference.relief_of_lines(SIDE, lines, 3.0, 1.0, 1.0)
    assert len(traced(device, relief)[1]) == 2
    points, found, _ = traced(device, relief, gap=14.0)
    assert len(found) == 1
    x = points.x[found[0]]
    assert max(x.min() - 20, 170 - x.max()) < 3
    assert (np.diff(x) > 0).all() or (np.diff(x) < 0).all()


def test_lines_that_cross_a_gap_sideways_stay_apart(device):
    lines = np.array([[20.0, 60.0, 90.0, 60.0], [95.0, 66.0, 95.0, 150.0]])
    relief = reference.relief_of_lines(SIDE, lines, 3.0, 1.0, 1.0)
    assert len(traced(device, relief, gap=14.0)[1]) == 2


def test_links_go_both_ways(device):
    points, _ = points_of(device, circle() + reference.relief_of_lines(
        SIDE, np.array([[10.0, 10.0, 180.0, 170.0]]), 3.0, 1.0, 1.0))  # fmt: skip
    links = chains.linked(points, (SIDE, SIDE))
    for side in (0, 1):
        there = links[:, side]
        some = np.flatnonzero(there >= 0)
        assert (links[there[some]] == some[:, None]).any(axis=1).all()


def test_links_do_not_depend_on_how_rows_are_cut(device, monkeypatch):
    points, _ = points_of(device, circle())
    whole = chains.linked(points, (SIDE, SIDE))
    monkeypatch.setattr(chains, "_ROWS", 16)
    assert (chains.linked(points, (SIDE, SIDE)) == whole).all()


@pytest.mark.parametrize(("half_width", "weight"), [(2.5, 0.3), (4.0, 0.6)])
def test_first_sizes_are_near_those_of_a_lone_line(device, half_width, weight):
    line = np.array([[20.0, 60.0, 170.0, 100.0]])
    _, _, lines = traced(device, reference.relief_of_lines(SIDE, line, half_width, weight, 1.0))
    inner = np.abs(lines.x - 95) < 60
    assert lines.half_width[inner] == pytest.approx(half_width, rel=0.3)
    assert lines.weight[inner] == pytest.approx(weight, rel=0.25)


def test_walls_of_a_pit_are_no_lines(device):
    relief = reference.relief_of_pores(SIDE, np.array([[90.0, 100.0]]), 6.0, 1.0)
    points, pits = points_of(device, relief)
    found = chains.chains_of(chains.linked(points, relief.shape))
    pores = pores_of(pits, 1.0)
    assert len(outside_pits(points, found, pores)) == 0
    assert pores.size == pytest.approx(6.0, rel=0.3)
    assert pores.weight == pytest.approx(1.0, rel=0.3)


def test_partners_follow_one_another_and_arrays_are_in_uv(device):
    _, _, lines = traced(device, circle())
    one = np.flatnonzero(lines.partners[:, 1] >= 0)
    assert len(one) >= len(lines) - 1
    assert (lines.edges[one, 1] == lines.edges[lines.partners[one, 1], 0]).all()
    pores = pores_of(points_of(device, circle())[1], 1.0)
    arrays = graph_arrays(lines, pores, 1012, SIDE)
    uv = arrays["node_uv"][: len(lines.x)] - [1.0, 1.0]
    away = np.hypot(*(uv * SIDE - [MIDDLE + 0.5, SIDE - MIDDLE - 0.5]).T)
    assert away == pytest.approx(60.0, abs=0.3)


def test_faint_wrinkles_are_left_out_and_partners_stay_right(device):
    _, _, lines = traced(device, circle())
    faded = lines.without_faint(float(np.quantile(lines.weight, 0.5)))
    assert 0 < len(faded) < len(lines)
    assert faded.edges.max() < len(faded.x)
    one = np.flatnonzero(faded.partners[:, 1] >= 0)
    assert (faded.edges[one, 1] == faded.edges[faded.partners[one, 1], 0]).all()
