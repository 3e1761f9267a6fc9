"""Leaders: where they are, which way they run, how far apart, and what others leave them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pipeline.test_stage_seams import folded as two_charts
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import depth_factor, wear
from rhytid.synthesis import leader_courses
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.leader_families import (
    CREASES,
    CROSSING,
    FROWN_LEFT,
    FROWN_RIGHT,
    FURROWS,
    LONGEST,
    PREFERRED,
    RHOMBI,
    RINGS,
    SHORTEST,
)
from rhytid.synthesis.leaders import LeaderPores, Leaders, leaders_of, unit_length
from rhytid.synthesis.painted_fields import fields_of
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

# A sheet of 100 pore spacings, which counts as 5 cm where the unit is not known.
MESH, COUNT, SPACING = sheets.sheet(), 15_000, 0.01
MILLIMETRE = 2 * SPACING


def folds(mesh: Mesh = MESH, angle: float = 0.0, size: float = 0.15) -> Folds:
    """Compressed along `angle` degrees to x right of the middle, and not at all left of it."""
    axis = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    rows = size**2 * np.outer(axis, axis)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    right = mesh.positions[:, 0] > np.median(mesh.positions[:, 0])
    return Folds((right[:, None] * rows).astype(np.float32), ENOUGH)


def traced(
    device: Device, mesh: Mesh, folds: Folds, seed: int = 1, spacing: float = SPACING
) -> tuple[Leaders, LeaderPores]:
    surface, across = Surface.of(mesh), neighbours(mesh)
    settings = GraphSettings(seed=seed)
    fields = fields_of(surface, settings, None, FoldField(mesh, surface, folds))
    with Workspace(device) as work:
        ground = Ground(work, surface, across, fields, Borders.of(mesh, surface, across))
        found = leaders_of(ground, spacing / surface.scale, settings)
        assert found is not None
        return found, found.pores(spacing / surface.scale)


@cache
def flat(device: Device) -> tuple[Leaders, LeaderPores]:
    return traced(device, MESH, folds())


@cache
def grown(device: Device, rank: float, patches: float = 1.0) -> Synthesis:
    settings = GraphSettings(wrinkles=COUNT, rank=rank, patches=patches)
    return synthesize(MESH, settings, device, folds=folds())


def lines_of(pores: LeaderPores) -> list[np.ndarray]:
    """(N, 3) the places of the pores of each leader."""
    return [pores.points.position[pores.line == line] for line in np.unique(pores.line)]


def test_they_run_across_what_is_compressed_and_nowhere_else(device: Device) -> None:
    _, pores = flat(device)
    assert (pores.points.uv[:, 0] > 0.47).all()
    ways = np.concatenate([np.diff(line, axis=0) for line in lines_of(pores)])
    turn = np.degrees(np.arctan2(ways[:, 1], ways[:, 0])) % 180.0
    assert np.median(turn) == pytest.approx(90.0, abs=8.0)
    assert np.percentile(np.abs(turn - 90.0), 90) < 35.0
    level = np.concatenate(
        [np.diff(line, axis=0) for line in lines_of(traced(device, MESH, folds(angle=90.0))[1])]
    )
    assert np.abs(level[:, 0]).sum() > 3 * np.abs(level[:, 1]).sum()


def test_they_are_long_uneven_and_smooth(device: Device) -> None:
    leaders, pores = flat(device)
    length = (leaders.last - leaders.first) * PREFERRED.pace
    assert len(leaders) > 10
    assert length.min() >= SHORTEST
    assert length.max() <= LONGEST
    assert length.std() > 1.5
    turns = []
    for line in lines_of(pores):
        way = np.diff(line, axis=0)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        turns += np.degrees(np.arccos(np.clip((way[1:] * way[:-1]).sum(axis=1), -1, 1))).tolist()
    assert np.percentile(turns, 95) < 25.0
    assert np.median(turns) < 12.0


def test_they_keep_their_distance(device: Device) -> None:
    leaders, pores = flat(device)
    place, line = pores.points.position, pores.line
    middle = np.flatnonzero(
        pores.depth > 0.7 * np.sqrt(leaders.courses.wishes.size[leaders.row])[line]
    )
    near = cKDTree(place).query_ball_point(place[middle], 1.2 * MILLIMETRE)
    assert all((line[found] == line[i]).all() for i, found in zip(middle, near, strict=True))


def test_they_end_before_a_hook(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over 5 mm in the middle the preferred direction turns by a right angle."""
    straight = (replace(PREFERRED, winding=()),)
    monkeypatch.setattr(leader_courses, "FAMILIES", straight)
    turn = 90.0 * np.clip(0.5 + (MESH.positions[:, 1] - 0.5) / (5 * MILLIMETRE), 0.0, 1.0)
    axis = np.exp(1j * np.radians(turn))
    rows = np.stack([axis.real**2, axis.imag**2, 0 * turn, axis.real * axis.imag], axis=1)
    tensor = np.concatenate([rows, np.zeros((len(turn), 2))], axis=1) * 0.15**2
    leaders, _ = traced(device, MESH, Folds(tensor.astype(np.float32), ENOUGH))
    courses, turns = leaders.courses, []
    for row, first, last in zip(leaders.row, leaders.first, leaders.last, strict=True):
        start = courses.start[row]
        way = np.diff(courses.points.position[start + first : start + last + 1], axis=0)
        way /= np.linalg.norm(way, axis=1)[:, None]
        turns += np.degrees(np.arccos(np.clip((way[2:] * way[:-2]).sum(axis=1), -1, 1))).tolist()
    assert len(leaders) > 10
    assert max(turns) < 32.0


def test_level_ones_cross_those_of_another_fold(device: Device) -> None:
    """Skin is compressed along x, and nearly as far along y."""
    both = np.zeros((len(MESH.positions), 6), np.float32)
    both[:, 0], both[:, 1] = 0.15**2, 0.12**2
    found = Folds(both, ENOUGH, {"forehead": np.ones(len(both), np.float32)})
    leaders, pores = traced(device, MESH, found)
    family = leaders.courses.wishes.family[leaders.row]
    crossing = np.isin(family, (CROSSING.number, FURROWS.number))
    assert 41.0 < ((leaders.last - leaders.first)[crossing] * CROSSING.pace).max() <= 60.0
    ways = [line[-1] - line[0] for line in lines_of(pores)]
    level = np.array([abs(way[0]) > 2 * abs(way[1]) for way in ways])
    upright = np.array([abs(way[1]) > 2 * abs(way[0]) for way in ways])
    assert min(level.sum(), upright.sum()) > 8
    place, line = pores.points.position, np.unique(pores.line, return_inverse=True)[1]
    near = cKDTree(place[level[line]]).query(place[upright[line]])[0]
    assert (near < 0.5 * MILLIMETRE).sum() > 8
    elsewhere = Folds(both, ENOUGH, {"cheek": np.ones(len(both), np.float32)})
    ways = [line[-1] - line[0] for line in lines_of(traced(device, MESH, elsewhere)[1])]
    assert np.mean([abs(way[1]) > abs(way[0]) for way in ways]) > 0.9


def crests(apart: float) -> np.ndarray:
    """(V,) a frown of two upright crests, left and right of 0.55."""
    at = MESH.positions
    beside = at[:, 0] - 0.55
    crest = np.clip(1.0 - np.abs(np.abs(beside) - 0.5 * apart) / 0.07, 0.0, 1.0)
    crest *= np.sign(beside) * (np.abs(at[:, 1] - 0.5) < 0.22)
    return crest.astype(np.float32)


@pytest.mark.parametrize("apart", [0.3, 0.16], ids=["15 mm", "8 mm"])
def test_a_frown_has_one_line_a_side_and_nothing_beside_it(device: Device, apart: float) -> None:
    """Skin is compressed along y, so that others run level."""
    pair = (FROWN_LEFT.number, FROWN_RIGHT.number)
    found = replace(folds(angle=90.0), frown=crests(apart))
    leaders, pores = traced(device, MESH, found)
    family = leaders.courses.wishes.family[leaders.row]
    lines = [pores.points.position[pores.line == n] for n in np.flatnonzero(np.isin(family, pair))]
    assert sorted(family[np.isin(family, pair)]) == sorted(pair)
    middle = sorted(line[:, 0].mean() for line in lines)
    assert middle == pytest.approx([0.55 - 0.5 * apart, 0.55 + 0.5 * apart], abs=0.035)
    assert min(np.ptp(line[:, 1]) for line in lines) > 10 * MILLIMETRE
    assert max(np.ptp(line[:, 0]) for line in lines) < 7 * MILLIMETRE
    depth = [pores.depth[pores.line == n].max() for n in np.flatnonzero(np.isin(family, pair))]
    assert 0.01 < abs(depth[0] / depth[1] - 1.0) < 0.25
    others = pores.points.position[~np.isin(pores.line, np.flatnonzero(np.isin(family, pair)))]
    assert len(others) > 50
    assert cKDTree(others).query(np.concatenate(lines))[0].min() > 3 * MILLIMETRE


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_pair_of_a_frown_goes_straight_on_and_upright(device: Device, seed: int) -> None:
    pair = (FROWN_LEFT.number, FROWN_RIGHT.number)
    leaders, _ = traced(device, MESH, replace(folds(angle=90.0), frown=crests(0.3)), seed)
    courses, family = leaders.courses, leaders.courses.wishes.family
    for row in leaders.row[np.isin(family[leaders.row], pair)]:
        place = courses.points.position[courses.start[row] : courses.start[row + 1]]
        way = np.diff(place, axis=0)
        lean = np.degrees(np.arctan(way[:, 0] / way[:, 1]))
        assert np.abs(lean).max() < 18.5
        assert np.abs(np.diff(lean)).mean() < 4.0


def lip(share: float = 1.0) -> np.ndarray:
    """(V,) a lip 12 mm high all along the middle of the sheet, with a border 4 mm wide."""
    border = (np.abs(MESH.positions[:, 1] - 0.5) - 4 * MILLIMETRE) / (4 * MILLIMETRE)
    return (share * np.clip(1.0 - border, 0.0, 1.0)).astype(np.float32)


def test_lips_have_creases_across_them_up_to_their_border(device: Device) -> None:
    """Skin folds right of the middle alone; lips have creases whatever folds them."""
    found = replace(folds(angle=90.0), regions={"lip": lip()})
    leaders, pores = traced(device, MESH, found, spacing=SPACING)
    family = leaders.courses.wishes.family[leaders.row]
    creases = np.flatnonzero(family == CREASES.number)
    lines = [pores.points.position[pores.line == n] for n in creases]
    lines = [line for line in lines if len(line) > 1]
    assert len(lines) > 20
    length = np.array([np.ptp(line[:, 1]) for line in lines]) / MILLIMETRE
    assert 2.0 < length.min() < 5.0 < length.max() < 11.0
    assert np.median([np.ptp(x[:, 0]) / np.ptp(x[:, 1]) for x in lines]) < 0.3
    every = np.concatenate(lines)
    assert np.abs(every[:, 1] - 0.5).max() < 7.5 * MILLIMETRE
    assert every[:, 0].min() < 0.2 < 0.8 < every[:, 0].max()
    middle = np.array([line.mean(axis=0) for line in lines])
    apart = cKDTree(middle).query(middle, k=2)[0][:, 1] / MILLIMETRE
    assert apart.min() > 0.4
    assert apart.std() > 0.15 * apart.mean()
    none = traced(device, MESH, replace(found, regions={"cheek": lip()}))[0]
    assert not (none.courses.wishes.family[none.row] == CREASES.number).any()


def test_creases_fill_the_gaps_between_other_leaders(device: Device) -> None:
    """Where a lip fades both run upright; other leaders keep 2.6 mm and more from one another."""
    leaders, pores = traced(device, MESH, replace(folds(), regions={"lip": lip(0.6)}))
    family = leaders.courses.wishes.family[leaders.row]
    place, creases = pores.points.position, family[pores.line] == CREASES.number
    inside = creases & (place[:, 0] > 0.6)
    assert (~creases).sum() > 100
    assert inside.sum() > 120
    apart = cKDTree(place[~creases]).query(place[inside])[0] / MILLIMETRE
    assert (apart < 1.5).mean() > 0.2


def test_they_taper_to_both_ends_and_differ_in_depth(device: Device) -> None:
    leaders, pores = flat(device)
    deepest = []
    for line in range(len(leaders)):
        depth = pores.depth[pores.line == line]
        assert max(depth[0], depth[-1]) < 0.35 * depth.max()
        tenth = len(depth) // 10 + 1
        assert max(depth[tenth - 1], depth[-tenth]) < 0.45 * depth.max()
        deepest.append(depth.max())
    assert np.std(deepest) > 0.1 * np.mean(deepest)


def test_those_as_deep_as_can_be_taper_too(device: Device) -> None:
    """Strength of the skin ends their depth in the middle; cut off there they would begin at
    once."""
    settings = GraphSettings(wrinkles=COUNT, patches=0.0, events=0.0, strength=4.0)
    graph = synthesize(MESH, settings, device, folds=folds()).graph
    assert graph.edge_share is not None
    weight = graph.edge_weight[graph.edge_share > 1.0]
    assert len(weight) > 100
    assert (weight > 0.99).mean() < 0.35
    assert (weight < 0.5).mean() > 0.25


def test_pores_on_them_are_as_far_apart_as_others_and_joined(device: Device) -> None:
    _, pores = flat(device)
    steps = np.concatenate([np.linalg.norm(np.diff(x, axis=0), axis=1) for x in lines_of(pores)])
    assert steps.min() > 1.05 * SPACING
    assert steps.max() < 1.7 * SPACING


@pytest.mark.parametrize("mesh", [sheets.tube(), two_charts()], ids=["tube", "charts"])
def test_they_cross_seams(device: Device, mesh: Mesh) -> None:
    """A tube that is compressed along its axis has rings, some of which go over the cut."""
    tensor = np.zeros((len(mesh.positions), 6), np.float32)
    tensor[:, 1] = 0.15**2
    _, pores = traced(device, mesh, Folds(tensor, ENOUGH), spacing=0.02)
    jumps = 0
    for line in np.unique(pores.line):
        of = np.flatnonzero(pores.line == line)
        apart = np.linalg.norm(np.diff(pores.points.position[of], axis=0), axis=1)
        assert apart.max() < 1.2 * 1.5 * 0.02
        jumps += int((np.abs(np.diff(pores.points.uv[of], axis=0)).max(axis=1) > 0.1).any())
    assert jumps > 1


def test_the_same_seed_gives_the_same_and_another_others(device: Device) -> None:
    one, again = flat(device)[1], traced(device, MESH, folds())[1]
    for name in ("line", "depth", "width"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    np.testing.assert_array_equal(one.points.uv, again.points.uv)
    other = traced(device, MESH, folds(), seed=2)[1]
    assert len(other) != len(one) or not np.array_equal(other.points.uv, one.points.uv)


def test_a_power_of_two_changes_nothing(device: Device) -> None:
    big = sheets.sheet(scale=4.0)
    one, two = flat(device)[1], traced(device, big, folds(big), spacing=4 * SPACING)[1]
    np.testing.assert_array_equal(one.points.uv, two.points.uv)
    np.testing.assert_array_equal(one.depth, two.depth)


def test_what_folds_elsewhere_moves_none(device: Device) -> None:
    """The upper half folds, too, or does not: far below the leaders are the same."""
    y = MESH.positions[:, 1]
    tensor = folds().tensor.copy()
    tensor[y > 0.8] = 0.0
    one, two = flat(device)[1], traced(device, MESH, Folds(tensor, ENOUGH))[1]
    below = [p.points.uv[p.points.position[:, 1] < 0.3].tolist() for p in (one, two)]
    assert below[0] == below[1]
    assert one.points.position[:, 1].max() > 0.9 > two.points.position[:, 1].max()


def test_even_skin_and_rank_0_have_none(device: Device) -> None:
    surface, across = Surface.of(MESH), neighbours(MESH)
    with Workspace(device) as work:
        ground = Ground(work, surface, across, Fields(), Borders.of(MESH, surface, across))
        assert leaders_of(ground, 0.01, GraphSettings()) is None
    assert grown(device, 0.0).graph.edge_share is None
    faint = synthesize(MESH, GraphSettings(wrinkles=3000), device, folds=folds(size=1e-3)).graph
    assert faint.edge_share is None
    assert synthesize(MESH, GraphSettings(wrinkles=3000), device).graph.edge_share is None


@pytest.mark.parametrize(
    ("unit", "spacing", "found"),
    [("cm", 0.05, 0.1), ("mm", 0.5, 1.0), (None, 0.05, 0.1), ("cm", 0.3, 0.3), ("ell", 0.05, 0.1)],
)
def test_millimetres_go_by_the_unit_or_by_the_pores(
    unit: str | None, spacing: float, found: float
) -> None:
    assert unit_length(unit, spacing) == pytest.approx(found)


def test_leaders_are_deepest_and_go_on_as_one(device: Device) -> None:
    graph = grown(device, 1.0).graph
    leads = np.flatnonzero(graph.edge_share > 1.0)
    others = np.setdiff1d(np.arange(graph.wrinkles), leads)
    assert 200 < len(leads) < 0.1 * graph.wrinkles
    assert graph.edge_half_width[leads].mean() > 1.5 * graph.edge_half_width[others].mean()
    assert (graph.edge_share[others] <= 1.0).all()
    partner = graph.edge_partners[leads]
    among = np.isin(partner, leads)
    assert among.all(axis=1).mean() > 0.7  # but at the ends of each
    plain = grown(device, 0.0).graph
    right = graph.node_uv[graph.edge_nodes[others], 0].mean(axis=1) > 0.55
    before = plain.node_uv[plain.edge_nodes, 0].mean(axis=1) > 0.55
    assert graph.edge_weight[others][right].mean() < 0.75 * plain.edge_weight[before].mean()


def test_over_a_strip_of_skin_the_mean_share_is_1(device: Device) -> None:
    graph = grown(device, 1.0).graph
    ends = sheets.places(Surface.of(MESH), graph)[graph.edge_nodes]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    mass = graph.edge_weight * graph.edge_half_width * length
    share = graph.edge_share.astype(float)
    assert (mass * share).sum() == pytest.approx(mass.sum(), rel=1e-5)
    middle, strip = ends.mean(axis=1), 8 * MILLIMETRE
    cell = np.floor(middle[:, :2] / strip).astype(int) @ [1, 100]
    for one in np.unique(cell):
        here = cell == one
        if mass[here].sum() > 0.2 * mass.sum() / len(np.unique(cell)):
            assert (mass * share)[here].sum() == pytest.approx(mass[here].sum(), rel=0.16)
    assert share.max() > 1.3
    assert share.min() < 0.9


def test_a_frown_takes_the_shortening_of_all_lines_beside_it(device: Device) -> None:
    """Between both lines, 15 mm apart, others lose some in the middle, and most beside them."""
    found = replace(folds(), frown=crests(0.3))
    graph = synthesize(MESH, GraphSettings(wrinkles=COUNT), device, folds=found).graph
    middle = sheets.places(Surface.of(MESH), graph)[graph.edge_nodes].mean(axis=1)
    aside, along = np.abs(middle[:, 0] - 0.55), np.abs(middle[:, 1] - 0.5)
    share, inside = graph.edge_share, along < 4 * MILLIMETRE
    usual = grown(device, 1.0).graph.edge_share
    pair = (np.abs(aside - 0.15) < 2 * MILLIMETRE) & inside
    assert share[pair].max() > usual.max() + 0.7
    assert 0.3 < share[inside & (aside < 3.5 * MILLIMETRE)].mean() < 0.95
    assert share[inside & (np.abs(aside - 0.11) < MILLIMETRE)].mean() < 0.6


def test_what_leaders_take_fades_to_their_ends(device: Device) -> None:
    """Pressed skin would make cuts of ends that take as much as the middle."""
    settings = GraphSettings(wrinkles=COUNT, patches=0.0, events=0.0, strength=4.0)
    graph = synthesize(MESH, settings, device, folds=folds()).graph
    more, weight = graph.edge_share - 1.0, graph.edge_weight
    leads = more > 0.0
    middle, ends = (more[leads & of] for of in (weight > 0.6, weight < 0.15))
    assert min(len(middle), len(ends)) > 30
    assert ends.mean() < 0.4 * middle.mean()


@pytest.mark.parametrize(("age", "broader"), [(20.0, 1.0), (50.0, 1.22), (65.0, 1.45)])
def test_old_leaders_are_broader(device: Device, age: float, broader: float) -> None:
    graphs = [
        synthesize(MESH, GraphSettings(wrinkles=COUNT, age=at), device, folds=folds()).graph
        for at in (35.0, age)
    ]
    every = (1.1 * 1.3**0.9) ** wear(age)  # all lines are, by region and by fold
    width = [g.edge_half_width[g.edge_share > 1.02].mean() for g in graphs]
    assert width[1] / width[0] == pytest.approx(broader * every, rel=0.08)


def test_old_leaders_around_the_mouth_stay_narrow_where_it_folds(device: Device) -> None:
    """Elsewhere leaders get 1.45 times as broad as other lines do."""
    settings = {"wrinkles": COUNT, "region": "mouth", "patches": 0.0}
    young, old = (
        synthesize(MESH, GraphSettings(age=at, **settings), device, folds=folds()).graph
        for at in (35.0, 65.0)
    )
    right = [g.node_uv[g.edge_nodes, 0].mean(axis=1) > 0.56 for g in (young, old)]
    width = [
        g.edge_half_width[of & (g.edge_share > 1.02)].mean()
        for g, of in zip((young, old), right, strict=True)
    ]
    every = 1.1 * 1.3**0.9
    assert 0.98 * every < width[1] / width[0] < 1.25 * every


def test_the_pair_of_a_frown_deepens_more_with_age_than_others_and_broadens_as_they_do(
    device: Device,
) -> None:
    """Broad ones were wax; as deep as others they were hardly seen at rest."""
    found = replace(folds(), frown=crests(0.3))
    graphs = [
        synthesize(MESH, GraphSettings(wrinkles=COUNT, age=age), device, folds=found).graph
        for age in (35.0, 50.0)
    ]
    width, depth = np.zeros((2, 2)), np.zeros((2, 2))
    for i, graph in enumerate(graphs):
        place = sheets.places(Surface.of(MESH), graph)[graph.edge_nodes].mean(axis=1)
        aside, along = np.abs(place[:, 0] - 0.55), np.abs(place[:, 1] - 0.5)
        pair = (np.abs(aside - 0.15) < 2 * MILLIMETRE) & (along < 4 * MILLIMETRE)
        leads = graph.edge_share > 1.02
        far = leads & (along > 16 * MILLIMETRE)
        for j, of in enumerate((leads & pair, far)):
            assert np.count_nonzero(of) > 10
            width[i, j] = graph.edge_half_width[of].mean()
            depth[i, j] = graph.edge_weight[of].mean()
    assert 0.85 < width[1, 0] / width[0, 0] * width[0, 1] / width[1, 1] < 1.1
    assert depth[1, 0] / depth[0, 0] > 1.2 * depth[1, 1] / depth[0, 1]


@pytest.mark.parametrize("age", [20.0, 65.0])
def test_creases_of_lips_are_of_any_age(device: Device, age: float) -> None:
    still = Folds(np.zeros((len(MESH.positions), 6), np.float32), ENOUGH, {"lip": lip()})
    graphs = [
        synthesize(MESH, GraphSettings(wrinkles=COUNT, age=at), device, folds=still).graph
        for at in (35.0, age)
    ]
    width, depth = (
        [getattr(g, name)[g.edge_share > 1.02].mean() for g in graphs]
        for name in ("edge_half_width", "edge_weight")
    )
    assert width[1] / width[0] == pytest.approx(1.1 ** wear(age), rel=0.08)
    # The deepest are as deep as lines can be, at 35 already.
    least, most = sorted([1.0, 1.3 ** wear(age)])
    assert 0.95 * least < depth[1] * depth_factor(age) / depth[0] < 1.05 * most


def test_pores_stay_apart_around_leaders(device: Device) -> None:
    made, even = (grown(device, rank, patches=0.0) for rank in (1.0, 0.0))
    pores = made.graph.own_nodes & (made.graph.node_kind == 0)
    place = sheets.places(Surface.of(MESH), made.graph)[pores]
    nearest = cKDTree(place).query(place, k=2)[0][:, 1]
    assert nearest.min() > 0.85 * made.spacing / 1.0935 * 0.999
    assert made.distance == pytest.approx(even.distance, rel=0.02)


def cylinder(turned: bool) -> Mesh:
    """A neck of 10 cm around the y axis, 12 cm wide, in cm; its UV as it is, or turned aslant."""
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 49), np.linspace(0, 10, 21))
    at = np.stack([6 * np.sin(angle), height, 6 * np.cos(angle)], axis=-1).reshape(-1, 3)
    uv = np.stack([6 * angle, height], axis=-1).reshape(-1, 2) / 50
    if turned:
        uv = uv @ np.array([[0.8, 0.6], [-0.6, 0.8]]) + [0.15, 0.0]
    first = (np.arange(20)[:, None] * 49 + np.arange(48)).reshape(-1)
    one, two = np.stack([first, first + 1, first + 50]), np.stack([first, first + 50, first + 49])
    faces = np.concatenate([one.T, two.T]).astype(np.int32)
    return Mesh(at.astype(np.float32), faces, uv.astype(np.float32), faces)


def off_a_line(height: np.ndarray) -> float:
    """Root mean square of what a straight line leaves of heights."""
    at = np.linspace(-1.0, 1.0, len(height))
    return float((height - np.polyval(np.polyfit(at, height, 1), at)).std())


@cache
def of_neck(device: Device, turned: bool) -> tuple[LeaderPores, float]:
    """Pores on the leaders of a neck, and how many centimetres the unit of their places has."""
    mesh = cylinder(turned)
    count = len(mesh.positions)
    still = Folds(np.zeros((count, 6), np.float32), 0, {"neck": np.ones(count, np.float32)})
    leaders, pores = traced(device, mesh, still, spacing=0.05)
    return pores, leaders.courses.ground.surface.scale


def of_family(pores: LeaderPores, *numbers: int) -> LeaderPores:
    """Those on leaders of families by their numbers."""
    of = np.flatnonzero(np.isin(pores.family, numbers))
    points, names = pores.points.take(of), ("line", "depth", "width", "profile", "family")
    return replace(pores, points=points, **{name: getattr(pores, name)[of] for name in names})


@pytest.mark.parametrize("turned", [False, True])
def test_a_neck_has_rings(device: Device, turned: bool) -> None:
    every, scale = of_neck(device, turned)
    pores = of_family(every, RINGS.number)
    rings = [line * scale for line in lines_of(pores)]
    assert 6 <= len(rings) <= 20
    length = [np.linalg.norm(np.diff(ring, axis=0), axis=1).sum() for ring in rings]
    assert min(length) > 4.3
    assert max(length) > 8.0
    assert max(np.ptp(ring[:, 1]) for ring in rings) < 2.0
    assert np.median([off_a_line(ring[:, 1]) for ring in rings]) > 0.04
    # Over half a centimetre none turns up or down like a worm.
    steps = [ring[10:] - ring[:-10] for ring in rings]
    slope = [np.abs(s[:, 1]) / np.hypot(s[:, 0], s[:, 2]) for s in steps]
    assert max(x.max() for x in slope) < 0.55
    depth = [pores.depth[pores.line == line] for line in np.unique(pores.line)]
    assert np.median([d[: len(d) // 10].max() / d.max() for d in depth]) < 0.2
    assert min(d[len(d) // 4 : -len(d) // 4].min() / d.max() for d in depth) < 0.1
    for i, ring in enumerate(rings):
        others = np.concatenate(rings[:i] + rings[i + 1 :])
        middle = ring[len(ring) // 4 : -len(ring) // 4]
        assert cKDTree(others).query(middle)[0].min() > 0.8


def slants(pores: LeaderPores) -> np.ndarray:
    """(N,) degrees to the left from the level direction, from each pore on a leader of a cylinder
    to the next."""
    found = []
    for line in lines_of(pores):
        way = np.diff(line, axis=0)
        out = (line[1:] + line[:-1])[:, [0, 2]]
        along = (way[:, 0] * out[:, 1] - way[:, 2] * out[:, 0]) / np.linalg.norm(out, axis=1)
        found.append(np.degrees(np.arctan2(way[:, 1], along)))
    return (np.concatenate(found) + 90.0) % 180.0 - 90.0


@pytest.mark.parametrize("turned", [False, True])
def test_a_neck_has_rhombi(device: Device, turned: bool) -> None:
    """Two families slant to either side of the level direction, uneven, and run on over rings."""
    every, scale = of_neck(device, turned)
    right, left = (of_family(every, family.number) for family in RHOMBI)
    assert np.median(slants(right)) == pytest.approx(-34.0, abs=4.0)
    assert np.median(slants(left)) == pytest.approx(34.0, abs=4.0)
    for pores in (right, left):
        lines = [line * scale for line in lines_of(pores)]
        length = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines]
        assert 0.6 < min(length) < 0.9
        assert 1.8 < max(length) < 3.1
        deepest = [pores.depth[pores.line == line].max() for line in np.unique(pores.line)]
        assert np.percentile(deepest, 90) > 1.5 * np.percentile(deepest, 10)
        middles = np.stack([line[len(line) // 2] for line in lines])
        apart = cKDTree(middles).query(middles, k=2)[0][:, 1]
        assert apart.std() > 0.25 * apart.mean()
    rings = cKDTree(of_family(every, RINGS.number).points.position * scale)
    near = rings.query(right.points.position * scale)[0] < 0.05
    assert near.sum() > 50


def test_rhombi_need_expressions_and_a_region_that_has_them() -> None:
    triangle, uv = np.zeros(1, np.int32), np.full((1, 2), 0.2, np.float32)
    surface, settings = Surface.of(MESH), GraphSettings(region="neck")
    fold = FoldField(MESH, surface, folds())
    assert fields_of(surface, settings, None, fold).rhombi(triangle, uv) == [1.0]
    assert fields_of(surface, settings, None).rhombi(triangle, uv) == [0.0]
    for other in ({"region": "face"}, {"anatomy": "coarse"}):
        found = fields_of(surface, replace(settings, **other), None, fold)
        assert found.rhombi(triangle, uv) == found.slant(triangle, uv) == [0.0]
