"""Strands: by chance fainter or stronger than those beside them, each for some pore spacings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.synthesis import ranks, strands
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lines import Lines
from rhytid.synthesis.strands import unevenness
from rhytid.synthesis.surface import Points
from synthesis.test_synthesis_leaders import MESH, folds

COUNT = 15_000
# Of the arrays of points: columns and kinds of numbers.
KINDS = ((0, np.int32), (2, np.float32), (3, np.float64), (3, np.float32))


def grown(device: Device, mesh: Mesh = MESH, **more: object) -> WrinkleGraph:
    settings = {"wrinkles": COUNT, "region": "mouth", "events": 0.0, "patches": 0.0} | more
    return synthesize(mesh, GraphSettings(**settings), device, folds=folds(mesh)).graph


@pytest.fixture(scope="module")
def skins(device: Device) -> tuple[WrinkleGraph, WrinkleGraph]:
    """Uneven skin, which folds right of the middle, and the same without chance."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strands, "UNEVEN", 0.0)
        even = grown(device)
    return grown(device), even


def test_strands_differ_where_skin_folds_and_nowhere_else(
    skins: tuple[WrinkleGraph, WrinkleGraph],
) -> None:
    uneven, even = skins
    np.testing.assert_array_equal(uneven.edge_nodes, even.edge_nodes)
    np.testing.assert_array_equal(uneven.edge_partners, even.edge_partners)
    ratio = uneven.edge_weight / even.edge_weight
    at = even.node_uv[even.edge_nodes, 0].mean(axis=1)
    assert (ratio[at < 0.45] == 1.0).all()
    assert (ratio[even.edge_share > 1.0] == 1.0).all()
    lines = (at > 0.56) & (even.edge_share < 1.0)
    assert 0.6 < np.log(ratio[lines]).std() < 1.1
    assert (ratio[lines] < 0.25).mean() > 0.15
    assert (ratio[lines] > 1.3).mean() > 0.05
    squares = [(skin.edge_weight[lines].astype(float) ** 2).mean() for skin in (uneven, even)]
    assert squares[0] / squares[1] == pytest.approx(0.55, abs=0.12)
    wider = uneven.edge_half_width / even.edge_half_width
    lines &= uneven.edge_weight < 1.0
    np.testing.assert_allclose(wider[lines], ratio[lines] ** strands.UNEVEN_WIDTH, rtol=1e-4)


def test_a_strand_is_alike_for_some_spacings_and_others_beside_it_are_not(
    skins: tuple[WrinkleGraph, WrinkleGraph],
) -> None:
    uneven, even = skins
    chance = np.log(uneven.edge_weight / even.edge_weight)
    at = even.node_uv[even.edge_nodes]
    lines = (at[..., 0].mean(axis=1) > 0.56) & (even.edge_share < 1.0)
    one, end = np.nonzero((even.edge_partners >= 0) & lines[:, None])
    two = even.edge_partners[one, end]
    inside = lines[two]
    assert np.corrcoef(chance[one[inside]], chance[two[inside]])[0, 1] > 0.8
    middle, way = at.mean(axis=1), at[:, 1] - at[:, 0]
    upright = np.flatnonzero(lines & (np.abs(way[:, 1]) > 2 * np.abs(way[:, 0])))
    near = cKDTree(middle[upright]).query(middle[upright], k=4)[1][:, 1:]
    first, second = np.repeat(upright, 3), upright[near.ravel()]
    aside = np.abs(middle[first] - middle[second])
    beside = aside[:, 0] > 2 * aside[:, 1]
    assert beside.sum() > 200
    assert np.corrcoef(chance[first[beside]], chance[second[beside]])[0, 1] < 0.35


def test_a_strand_goes_on_over_a_seam_and_both_halves_are_alike() -> None:
    """Four wrinkles in a row, the second of which is in two halves."""
    pores = Points(*(np.zeros((5, n), t) for n, t in KINDS))
    pores.uv[:, 0] = np.linspace(0.0, 1.0, 5)
    joined = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [1, 2]], np.int32)
    copy_of = np.array([-1, -1, -1, -1, 1], np.int32)
    rest = [np.empty(0)] * 4
    lines = Lines(np.arange(5), joined, joined, np.empty(0), np.empty(0), copy_of, *rest)
    partners = np.array([[-1, 1], [0, 4], [4, 3], [2, -1], [1, 2]], np.int32)
    factor, width = unevenness(pores, lines, partners, np.ones(5, np.float32), 1)
    np.testing.assert_allclose(factor, factor[0], rtol=1e-5)
    assert abs(np.log(factor[0])) > 0.01
    np.testing.assert_allclose(width, factor**strands.UNEVEN_WIDTH, rtol=1e-5)
    # Below 0 for none: -1, and -2 of a line that ends alone.
    apart, alone = (
        unevenness(pores, lines, np.full((5, 2), none, np.int32), np.ones(5, np.float32), 1)[0]
        for none in (-1, -2)
    )
    np.testing.assert_array_equal(alone, apart)
    assert np.log(apart[:4]).std() > 0.3
    assert apart[4] == apart[1]


def test_many_lines_on_several_threads_are_as_on_one(monkeypatch: pytest.MonkeyPatch) -> None:
    count, rng = 150_000, np.random.default_rng(3)
    pores = Points(*(np.zeros((count + 1, n), t) for n, t in KINDS))
    pores.uv[:] = rng.random(pores.uv.shape)
    row = np.arange(count, dtype=np.int32)
    joined, rest = np.stack([row, row + 1], axis=1), [np.empty(0)] * 4
    lines = Lines(row, joined, joined, np.empty(0), np.empty(0), np.full(count, -1), *rest)
    partners = np.stack([row - 1, np.append(row[1:], -1)], axis=1).astype(np.int32)
    amount = np.where(rng.random(count) < 0.9, rng.random(count), 0.0).astype(np.float32)
    found = unevenness(pores, lines, partners, amount, 1)
    monkeypatch.setattr(strands, "over_rows", lambda rows, task: task(slice(0, rows)))
    for many, one in zip(found, unevenness(pores, lines, partners, amount, 1), strict=True):
        np.testing.assert_array_equal(many, one)
        assert (many[amount == 0] == 1.0).all()
    assert np.log(found[0][amount > 0]).std() > 0.1


@pytest.mark.parametrize(("name", "value"), [("rank", 0.0), ("region", "cheek")])
def test_without_ranks_and_in_other_regions_nothing_differs(
    device: Device, monkeypatch: pytest.MonkeyPatch, name: str, value: object
) -> None:
    settings = {"wrinkles": 3000, name: value}
    one = grown(device, **settings)
    monkeypatch.setattr(strands, "UNEVEN", 0.0)
    np.testing.assert_array_equal(one.edge_weight, grown(device, **settings).edge_weight)


@pytest.mark.parametrize(("rank", "share"), [(0.5, 0.5), (2.0, 1.0)])
def test_strands_differ_by_rank_and_no_more_above_1(
    device: Device, monkeypatch: pytest.MonkeyPatch, rank: float, share: float
) -> None:
    """On skin that folds a little, which would else be twice as uneven by a rank of 2."""
    little = folds(MESH, size=0.02)
    of, found = ranks.Ranks.of, []
    monkeypatch.setattr(ranks.Ranks, "of", lambda *a: found.append(of(*a)) or found[-1])
    for one in (1.0, rank):
        settings = GraphSettings(wrinkles=3000, region="mouth", rank=one)
        synthesize(MESH, settings, device, folds=little)
    whole, part = (ranked.uneven for ranked in found)
    assert 0.1 < np.median(whole[whole > 0]) < 0.5
    np.testing.assert_allclose(part, share * whole, rtol=1e-5)


@pytest.mark.parametrize(("region", "kept"), [("mouth", 0.25), ("forehead", 1.0)])
def test_where_directions_whirl_around_a_mouth_lines_are_faint(
    device: Device, monkeypatch: pytest.MonkeyPatch, region: str, kept: float
) -> None:
    """Skin is compressed along x, and right of the middle in all directions alike."""
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    tensor[:, 0] = 0.15**2
    tensor[MESH.positions[:, 0] > np.median(MESH.positions[:, 0]), 1] = 0.15**2
    settings = GraphSettings(wrinkles=COUNT, region=region, events=0.0, patches=0.0)

    def skin() -> WrinkleGraph:
        return synthesize(MESH, settings, device, folds=Folds(tensor, ENOUGH)).graph

    faint = skin()
    monkeypatch.setattr(ranks, "_CRUMPLED", 0.0)
    usual = skin()
    np.testing.assert_array_equal(faint.edge_nodes, usual.edge_nodes)
    at = usual.node_uv[usual.edge_nodes, 0].mean(axis=1)
    lines = (usual.edge_weight > 0.05) & (usual.edge_weight < 1.0) & (at > 0.6)
    ratio = faint.edge_weight / usual.edge_weight
    assert lines.sum() > 500
    np.testing.assert_allclose(ratio[lines], kept, rtol=1e-4)
    assert (ratio[at < 0.4] == 1.0).all()
