"""Skin of one seed at several ages: the same pores, older lines."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS, aged, depth_factor, fold_factor_log, wear
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.leader_families import CREASES, FAMILIES, FANS, FURROWS, RINGS
from rhytid.synthesis.painted_fields import PaintedFields, fields_of
from rhytid.synthesis.ranks import _left_to, _older
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.painted import painted, right

MESH = sheets.sheet()
SURFACE = Surface.of(MESH)
COUNT = 12_000
EVEN = GraphSettings(wrinkles=COUNT, patches=0.0, events=0.0)
# Root mean square log compression along x, right of the middle.
SIZE = 0.12


@cache
def folds() -> Folds:
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    x = MESH.positions[:, 0]
    tensor[x > x.mean(), 0] = SIZE**2
    return Folds(tensor, ENOUGH)


@cache
def grown(device: Device, age: float) -> Synthesis:
    return synthesize(MESH, replace(EVEN, age=age), device, folds=folds())


def places() -> tuple[np.ndarray, np.ndarray]:
    triangle = np.flatnonzero(SURFACE.carries)
    return triangle, SURFACE.uv[triangle].mean(axis=1)


def depths(made: Synthesis) -> dict[tuple[int, ...], float]:
    """In units of the depth at 35, by the pores that a wrinkle joins."""
    ends = map(tuple, np.sort(made.graph.edge_nodes, axis=1).tolist())
    depth = made.graph.edge_weight * made.lengths.depth / (0.15 * made.spacing)
    return dict(zip(ends, depth.tolist(), strict=True))


def ranked(values: list[float]) -> np.ndarray:
    """Their ranks, of equal ones the mean; scipy.stats takes half a second to import."""
    _, of, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * (count - 1))[of]


def test_at_35_skin_is_what_it_was(device: Device) -> None:
    plain = synthesize(MESH, EVEN, device).graph
    at_35 = synthesize(MESH, replace(EVEN, age=35.0), device).graph
    assert type(fields_of(SURFACE, GraphSettings(age=35.0), None)) is Fields
    for name, array in plain.arrays().items():
        np.testing.assert_array_equal(array, at_35.arrays()[name])


@pytest.mark.parametrize("age", [20.0, 50.0, 70.0])
def test_pores_stay_where_they_are(device: Device, age: float) -> None:
    one, two = grown(device, 35.0), grown(device, age)
    np.testing.assert_array_equal(one.graph.node_uv, two.graph.node_uv)
    assert one.graph.wrinkles == two.graph.wrinkles == COUNT
    assert one.spacing == two.spacing
    assert two.lengths.depth == pytest.approx(depth_factor(age) * one.lengths.depth)


@pytest.mark.parametrize(("age", "alike"), [(20.0, 0.72), (65.0, 0.88)])
def test_it_is_the_same_skin(device: Device, age: float, alike: float) -> None:
    one, two = depths(grown(device, 35.0)), depths(grown(device, age))
    both = one.keys() & two.keys()
    assert len(both) > 0.9 * len(one)
    # Which are deep stays; by how much does not.
    ranks = [ranked([depth[k] for k in both]) for depth in (one, two)]
    assert np.corrcoef(*ranks)[0, 1] > alike
    # And a small step of age is a small step of skin.
    near = depths(grown(device, 36.0))
    both = one.keys() & near.keys()
    assert len(both) > 0.985 * len(one)
    assert np.corrcoef([one[k] for k in both], [near[k] for k in both])[0, 1] > 0.985


def test_what_folds_deepens_most(device: Device) -> None:
    found = {
        age: strongest(grown(device, age).graph, depth_factor(age)) for age in (20.0, 35.0, 65.0)
    }
    for side in (0, 1):
        assert found[20.0][side] < found[35.0][side] < found[65.0][side]
    still, folding = (found[65.0][side] / found[35.0][side] for side in (0, 1))
    assert folding > 1.25 * still


def strongest(graph: WrinkleGraph, depth: float) -> tuple[float, float]:
    """The 95th percentile of depths, left and right of u = 0.5."""
    u = graph.node_uv[graph.edge_nodes, 0].mean(axis=1)
    weight = depth * graph.edge_weight
    return tuple(float(np.percentile(weight[side], 95)) for side in (u < 0.45, u > 0.55))


def test_faint_lines_fade_so_that_deep_ones_are_farther_apart(device: Device) -> None:
    """The share of wrinkles that carry nine tenths of the squared depth."""

    def share(age: float) -> float:
        squares = np.sort(grown(device, age).graph.edge_weight.astype(np.float64) ** 2)[::-1]
        return float((np.cumsum(squares) < 0.9 * squares.sum()).mean())

    young, usual, old = share(20.0), share(35.0), share(65.0)
    assert usual > old + 0.03
    assert young == pytest.approx(usual, abs=0.02)


@pytest.mark.parametrize("age", [20.0, 45.0, 65.0])
@pytest.mark.parametrize("region", ["cheek", "eye_corner"])
def test_factors_in_double(age: float, region: str) -> None:
    """Each field at a place is what region and fold make of it there."""
    field = FoldField(MESH, SURFACE, folds(), age)
    settings = GraphSettings(region=region, age=age)
    found = PaintedFields(SURFACE, settings, Controls({}), field)
    plain = PaintedFields(
        SURFACE, GraphSettings(region=region), Controls({}), FoldField(MESH, SURFACE, folds())
    )
    triangle, uv = places()
    skin, base, t = aged(REGIONS[region], age), REGIONS[region], wear(age)
    share = np.where(uv[:, 0] > 0.55, np.tanh(SIZE / 0.10), 0.0)
    inner = (uv[:, 0] < 0.45) | (uv[:, 0] > 0.55)

    def ratio(name: str) -> np.ndarray:
        return (getattr(found, name)(triangle, uv) / getattr(plain, name)(triangle, uv))[inner]

    old = (
        base.old.strength**t
        / depth_factor(age)
        * np.exp(fold_factor_log("strength", age) * share[inner])
    )
    np.testing.assert_allclose(ratio("strength"), old, rtol=2e-6)
    wide = base.old.scale**t * np.exp(fold_factor_log("width", age) * share[inner])
    np.testing.assert_allclose(ratio("width"), wide, rtol=2e-6)
    lead = np.exp(fold_factor_log("primary", age) * share[inner])
    np.testing.assert_allclose(ratio("primary"), lead, rtol=2e-6)
    pores = base.old.pore_strength**t / depth_factor(age)
    np.testing.assert_allclose(ratio("pore_strength"), pores, rtol=2e-6)
    np.testing.assert_allclose(found.contrast(triangle, uv), skin.contrast, rtol=2e-6)
    np.testing.assert_allclose(ratio("grain"), base.old.grain**t / depth_factor(age), rtol=2e-6)
    np.testing.assert_allclose(found.grain(triangle, uv), skin.grain, rtol=2e-6)
    assert (ratio("spacing") == 1.0).all()


def test_age_reaches_only_the_region_that_is_painted() -> None:
    """Where a mask ends the factors of the other region begin: age has no mean over the face."""
    controls = painted(region_cheek=right(1.0, 0.0))
    triangle, uv = places()
    left, there = uv[:, 0] < 0.45, uv[:, 0] > 0.55
    found = PaintedFields(SURFACE, GraphSettings(age=65.0), controls).contrast(triangle, uv)
    np.testing.assert_allclose(found[left], REGIONS["face"].old.contrast, rtol=2e-6)
    np.testing.assert_allclose(found[there], REGIONS["cheek"].old.contrast, rtol=2e-6)


def weights(device: Device, age: float, region: str) -> tuple[np.ndarray, np.ndarray]:
    """Of lines that leaders are made of, and of others, where skin folds."""
    settings = replace(EVEN, age=age, region=region)
    graph = synthesize(MESH, settings, device, folds=folds()).graph
    assert graph.edge_share is not None
    leads = graph.edge_share > 1.0
    there = graph.node_uv[graph.edge_nodes, 0].min(axis=1) > 0.55
    return graph.edge_weight[leads & there], graph.edge_weight[~leads & there]


def test_small_leaders_come_up_to_large_ones(device: Device) -> None:
    def low(age: float) -> float:
        quarter, most = np.percentile(weights(device, age, "face")[0], [25, 90])
        return float(quarter / most)

    young, middle, old = low(35.0), low(50.0), low(65.0)
    assert young * 1.15 < middle
    assert middle * 1.1 < old


def test_ages_of_the_mouth_differ(device: Device) -> None:
    """Its leaders deepen from 35 to 50 and from 50 to 65, while other lines hardly do."""
    ages = (35.0, 50.0, 65.0)
    found = [weights(device, age, "mouth") for age in ages]
    deep = [np.mean(found[n][0]) * depth_factor(age) for n, age in enumerate(ages)]
    assert deep[1] > 1.4 * deep[0]
    assert deep[2] > 1.3 * deep[1]
    assert (found[1][0] > 0.999).mean() < 0.2
    rank = [np.mean(lead) / np.mean(other) for lead, other in found]
    assert rank[0] < 0.85 * rank[1] < 0.85 * 0.9 * rank[2]


def test_leaders_are_no_older_up_to_35() -> None:
    """Not by a bit: weights of young skin stay what they were."""
    share = np.linspace(0.0, 1.0, 97, dtype=np.float32)
    profile, leading = share[::-1].copy(), np.sqrt(share)
    for worn in (0.0, -0.5):
        deeper, found = _older(share, profile, leading, np.full(97, worn))
        np.testing.assert_array_equal(deeper, np.ones(97))
        np.testing.assert_array_equal(found, profile)
    assert (_older(share, profile, leading, np.ones(97))[0] > 1.2).any()


def test_old_leaders_take_little_of_the_shortening(device: Device) -> None:
    """They are deep at rest: pressed as hard as at 35 they would be cuts with sides of 60
    degrees."""

    def taken(age: float) -> float:
        share = grown(device, age).graph.edge_share
        assert share is not None
        return float((share[share > 1.0] - 1.0).mean())

    young, middle, old = taken(35.0), taken(50.0), taken(65.0)
    assert 0.02 * young < old < 0.12 * young
    assert 0.2 * young < middle < 0.4 * young


def test_what_leaders_take_hangs_on_their_family_and_on_age_above_35() -> None:
    """Up to 35 all of it is left, to the bit; at any age to those that never were cuts."""
    families = np.arange(len(FAMILIES), dtype=np.int8)
    for worn in (-1.0, -0.5, 0.0):
        np.testing.assert_array_equal(_left_to(families, worn), np.ones(len(FAMILIES), np.float32))
    found, soft = _left_to(families, 1.0), [f.number for f in (CREASES, FANS, FURROWS, RINGS)]
    np.testing.assert_array_equal(found[soft], np.ones(len(soft), np.float32))
    np.testing.assert_allclose(np.delete(found, soft), 0.1, rtol=1e-6)


def test_ends_of_old_leaders_stay_faint() -> None:
    """Where skin of 35 has a tenth or a fifth of the depth, that of 65 has little more."""
    share, whole = np.array([0.1, 0.2, 1.0]), np.ones(3)
    _, found = _older(whole, share, whole, whole)
    assert (found <= [0.15, 0.27, 1.0]).all()
