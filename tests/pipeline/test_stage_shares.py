"""Shares of the shortening of skin in precomputed maps: what they make of each sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import BinnedScene, stored_maps
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from pipeline.test_stage_bends import shared
from reference.bends import shared_depth
from rhytid.domain.graph import WrinkleGraph
from rhytid.pipeline.bins import EVEN, ShareRange, quantisation_steps, sample_stretches
from rhytid.pipeline.blend import Blend

GRAPH = random_graph(21, 300)
FACTORED = {"count": 4, "samples": 5, "bits": 16, "depth_factored": True, "merge": "signed"}
ALONE = WrinkleGraph(
    node_uv=np.array([[0.33, 0.64], [0.73, 0.64]], np.float32),
    node_weight=np.zeros(2, np.float32),
    node_radius=np.full(2, 0.01, np.float32),
    edge_nodes=np.array([[0, 1]]),
    edge_weight=np.array([0.5], np.float32),
    edge_half_width=np.array([0.04], np.float32),
    edge_share=np.array([1.37], np.float32),
)


def heights(made):
    """(maps, P) of the wrinkles of a scene."""
    bins = made.settings.bins
    steps = quantisation_steps(made.settings, ShareRange.of(made.graph))
    return stored_maps(made.device, made.tile, bins) * steps.reshape(-1, 1)


def blended(made, positions):
    blend = Blend(made.device, made.settings, len(made.mesh.faces), ShareRange.of(made.graph))
    stretch = made.stretch(positions)
    lines = None if made.tile.cushion is None else made.lines(stretch)
    out = blend.tile(made.tile, blend.coefficients(stretch), lines=lines)
    return made.device.read(out, (64, 64), np.float32)


def redrawn(made, positions):
    return made.redrawn(positions, at=(64, 128), side=64)


BOTH = (blended, redrawn)


@pytest.mark.parametrize("factored", [True, False])
def test_each_sample_has_the_depths_that_shares_make_of_it(device, factored):
    """As drawn from a graph whose weights are that much larger, and that has no shares."""
    bins = {**FACTORED, "depth_factored": factored}
    settings = settings_of(bins=bins, response={"alpha_d": 4.0, "ends": 0.0})
    weight = GRAPH.edge_weight * np.float32(0.2)
    graph = replace(shared(GRAPH), edge_weight=weight)
    made = BinnedScene(device, sheet(), graph, settings)
    for sample, r in enumerate(sample_stretches(settings)):
        factor = shared_depth(r, 4.0, graph.edge_share).astype(np.float32)
        other = BinnedScene(device, sheet(), replace(GRAPH, edge_weight=weight * factor), settings)
        rows = np.arange(4) * 5 + sample
        step = quantisation_steps(settings, ShareRange.of(graph)).max()
        found, wanted = heights(made)[rows], heights(other)[rows]
        assert np.abs(wanted).max() > 0.05 * DEPTH
        assert np.abs(found - wanted).max() <= step + 1e-4 * DEPTH


@pytest.mark.parametrize("cushion", [0.0, 0.9])
@pytest.mark.parametrize("r", [-0.3, -0.2, -0.05, 0.1])
def test_maps_of_a_lone_wrinkle_blend_to_its_redrawing(device, r, cushion):
    """Of one as wide at any stretch, at samples and between them, where no limit is reached."""
    response, shape = {"alpha_w": 0.0, "ends": 0.0}, {"cushion": cushion}
    settings = settings_of(bins={**FACTORED, "r_max": 0.3}, response=response, shape=shape)
    made = BinnedScene(device, sheet(), ALONE, settings)
    positions = (np.exp(r) * made.mesh.positions).astype(np.float32)
    wanted = redrawn(made, positions)
    plain = redrawn(Scene(device, made.mesh, replace(ALONE, edge_share=None), settings), positions)
    assert np.abs(wanted - plain).max() > 0.07 * np.abs(plain).max()
    inside = np.s_[:, 16:]  # where every texel has a triangle
    assert np.abs(blended(made, positions) - wanted)[inside].max() <= 4e-3 * DEPTH


@pytest.mark.parametrize("r", [-0.5, -0.25, -0.15])
def test_maps_are_as_deep_as_redrawing_cuts_them_off(device, r):
    """Of a wrinkle with a large share, pressed as far as a sample is."""
    lone = replace(ALONE, edge_share=np.array([2.9], np.float32))
    response, shape = {"alpha_d": 4.0, "alpha_w": 0.0, "ends": 0.0}, {"cushion": 0.0}
    settings = settings_of(bins={**FACTORED, "r_max": -r}, response=response, shape=shape)
    made = BinnedScene(device, sheet(), lone, settings)
    positions = (np.exp(r) * made.mesh.positions).astype(np.float32)
    inside = np.s_[:, 16:]
    found, wanted = (-values[inside].min() for values in (f(made, positions) for f in BOTH))
    assert wanted > 0.5 * DEPTH
    assert found / wanted == pytest.approx(1.0, abs=0.02)


def test_the_range_of_codes_holds_the_deepest_share():
    settings = settings_of(bins=FACTORED, response={"alpha_d": 4.0})
    graph = shared(GRAPH)
    shares = ShareRange.of(graph)
    assert shares == ShareRange(float(graph.edge_share.min()), float(graph.edge_share.max()))
    assert ShareRange.of(GRAPH) == EVEN
    plain, found = quantisation_steps(settings), quantisation_steps(settings, shares)
    np.testing.assert_array_equal(found[-1], plain[-1])  # pores have none
    for sample, r in enumerate(sample_stretches(settings)):
        most = max(shared_depth(r, 4.0, graph.edge_share).max(), 1.0)
        np.testing.assert_allclose(found[0, sample] / plain[0, sample], (most + 0.2) / 1.2, 1e-5)


def test_a_blend_is_as_near_to_its_redrawing_as_without_shares(device):
    positions, errors = deform(sheet().positions, 5, 0.05), []
    for graph in (GRAPH, shared(GRAPH)):
        made = BinnedScene(device, sheet(), graph, settings_of(bins={**FACTORED, "r_max": 0.3}))
        off = blended(made, positions) - redrawn(made, positions)
        errors.append(float(np.sqrt(np.square(off).mean())))
    assert errors[1] < 1.5 * errors[0]
