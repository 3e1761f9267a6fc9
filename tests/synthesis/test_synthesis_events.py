"""Events: where they are placed, and what they are in a graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, GraphSettings
from rhytid.domain.events import EVENT_NAMES, EVENTS
from rhytid.domain.graph import ORIGINAL
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import REGIONS
from rhytid.engine.assets.graphs import mean_spacing
from rhytid.formats.graphs import read_graph, write_graph
from rhytid.synthesis.events import Events, events_of
from rhytid.synthesis.fields import Factors
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lattice import Around
from rhytid.synthesis.painted_fields import fields_of
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.statistics import statistics
from rhytid.synthesis.surface import Surface
from synthesis.painted import painted, right
from synthesis.sheets import places, sheet, tube, uneven

# Of a sheet of side 1: it is 10 cm wide.
SPACING = 0.005
SETTINGS = GraphSettings(spacing=SPACING, events=2.0, region="cheek")


def placed(
    mesh: Mesh, settings: GraphSettings = SETTINGS, controls=None, spacing=SPACING, unit=None
):
    """The events of a mesh, and their places in its units."""
    surface = Surface.of(mesh)
    fields = fields_of(surface, settings, controls)
    events = events_of(surface, fields, settings, spacing / surface.scale, unit)
    assert events is not None
    return events, events.points.position * surface.scale


def rows(events: Events, at: NDArray[np.float64]) -> set[tuple[float, ...]]:
    """What events are and where, for comparison."""
    values = np.column_stack([at, events.kind, events.weight])
    return {tuple(row) for row in values.tolist()}


def renumbered(mesh: Mesh) -> Mesh:
    """The same mesh with its triangles and their corners in another order."""
    rng = np.random.default_rng(4)
    order = rng.permutation(len(mesh.faces))
    turn = (np.arange(3) + rng.integers(0, 3, (len(order), 1))) % 3
    faces, face_uv = (
        np.take_along_axis(f[order], turn, axis=1) for f in (mesh.faces, mesh.face_uv)
    )
    return Mesh(mesh.positions, faces, mesh.uv, face_uv)


def test_the_number_of_wrinkles_changes_no_size_where_the_unit_is_known() -> None:
    """Nor does density: heights are the same in millimetres, though lines are shallower."""
    usual, there = placed(sheet(), unit="dm")
    few, same = placed(sheet(), spacing=1.5 * SPACING, unit="dm")
    np.testing.assert_array_equal(same, there)
    np.testing.assert_array_equal(few.radius, usual.radius)
    np.testing.assert_allclose(few.weight, usual.weight / 1.5, rtol=1e-6)
    dense, _ = placed(sheet(), replace(SETTINGS, density=4.0), spacing=0.5 * SPACING, unit="dm")
    np.testing.assert_array_equal(dense.radius, usual.radius)
    np.testing.assert_allclose(dense.weight, 2.0 * usual.weight, rtol=1e-6)


def test_no_event_is_higher_than_a_graph_can_have() -> None:
    fine, _ = placed(sheet(), replace(SETTINGS, events=4.0), spacing=0.02 * SPACING, unit="dm")
    assert fine.weight.max() == 1.0


def test_where_pores_are_far_apart_a_millimetre_is_as_long() -> None:
    """So that a wrong unit does not ask for more events than there are pores."""
    wrong, _ = placed(sheet(), unit="m")
    wide, _ = placed(sheet(), spacing=0.5 * SPACING)
    np.testing.assert_allclose(np.sort(wrong.radius), np.sort(wide.radius), rtol=1e-6)


def test_every_kind_occurs_and_none_without_events() -> None:
    events, _ = placed(sheet(), replace(SETTINGS, events=4.0))
    assert set(events.kind) == set(range(1, len(EVENTS) + 1))
    surface = Surface.of(sheet())
    settings = replace(SETTINGS, events=0.0)
    assert events_of(surface, fields_of(surface, settings, None), settings, SPACING) is None


@pytest.mark.parametrize("other", [renumbered(sheet()), sheet(uneven), renumbered(sheet(uneven))])
def test_neither_the_uv_nor_the_order_of_triangles_counts(other: Mesh) -> None:
    events, at = placed(sheet())
    found, there = placed(other)
    np.testing.assert_allclose(there, at, atol=1e-12)
    np.testing.assert_array_equal(found.kind, events.kind)
    np.testing.assert_array_equal(found.weight, events.weight)


def test_a_power_of_two_changes_nothing() -> None:
    events, at = placed(sheet())
    large = replace(SETTINGS, spacing=4.0 * SPACING)
    found, there = placed(sheet(scale=4.0), large, spacing=4.0 * SPACING)
    np.testing.assert_array_equal(there, 4.0 * at)
    for name in ("kind", "weight", "metric", "circle"):
        np.testing.assert_array_equal(getattr(found, name), getattr(events, name))


def test_another_unit_changes_next_to_nothing() -> None:
    events, at = placed(sheet())
    large = replace(SETTINGS, spacing=10.0 * SPACING)
    found, there = placed(sheet(scale=10.0), large, spacing=10.0 * SPACING)
    apart, which = cKDTree(at).query(there / 10.0)
    same = (apart < 1e-6) & (found.kind == events.kind[which])
    assert same.mean() > 0.98
    assert abs(len(found) - len(events)) <= 0.02 * len(events)


def test_another_seed_places_others() -> None:
    one, other = (rows(*placed(sheet(), replace(SETTINGS, seed=seed))) for seed in (1, 2))
    assert not one & other


def test_more_events_leave_most_where_they_are() -> None:
    few, many = (rows(*placed(sheet(), replace(SETTINGS, events=n))) for n in (1.0, 2.0))
    assert 1.6 * len(few) < len(many) < 2.4 * len(few)
    assert len(few & many) > 0.93 * len(few)


@pytest.mark.parametrize("region", sorted(REGIONS.keys() - {"lip"}))
def test_there_are_as_many_as_the_table_says(region: str) -> None:
    settings = replace(SETTINGS, events=4.0, region=region, age=50.0)
    events, _ = placed(sheet(), settings)
    for kind, name in enumerate(EVENT_NAMES, 1):
        expected = 4.0 * 100.0 * EVENTS[name].rate(region, 50.0)
        # Groups differ, and what is too close to others is left out.
        slack = 4.0 * np.sqrt(expected) + 0.45 * expected * (EVENTS[name].groups > 0)
        assert abs((events.kind == kind).sum() - 0.92 * expected) <= slack + 0.08 * expected


def test_a_lip_has_none() -> None:
    surface, settings = Surface.of(sheet()), replace(SETTINGS, events=4.0, region="lip")
    assert events_of(surface, fields_of(surface, settings, None), settings, SPACING) is None


def test_events_keep_their_distance() -> None:
    events, at = placed(sheet(), replace(SETTINGS, events=4.0, region="nose"))
    radius = events.radius * Surface.of(sheet()).scale
    one, two = cKDTree(at).query_pairs(2.0 * radius.max(), output_type="ndarray").T
    apart = np.linalg.norm(at[one] - at[two], axis=1)
    assert (apart >= 0.8 * (radius[one] + radius[two]) - 1e-12).all()


def test_painted_black_has_none_and_mid_grey_as_without() -> None:
    whole = rows(*placed(sheet()))
    events, at = placed(sheet(), controls=painted(events=right(0.0)))
    assert events.points.uv[:, 0].max() < 0.52
    mine = {row for row in whole if row[0] < 0.45}
    assert mine == {row for row in rows(events, at) if row[0] < 0.45}
    assert rows(*placed(sheet(), controls=painted(events=right(0.5)))) == whole


def test_painted_white_is_double() -> None:
    whole = len(placed(sheet())[0])
    doubled = len(placed(sheet(), controls=painted(events=right(1.0, 1.0)))[0])
    assert 1.6 * whole < doubled < 2.4 * whole


def test_painted_strength_hides_events_and_moves_none() -> None:
    usual, _ = placed(sheet())
    hidden, _ = placed(sheet(), controls=painted(strength=right(0.0)))
    np.testing.assert_array_equal(hidden.points.uv, usual.points.uv)
    dark, light = (u(usual.points.uv[:, 0]) for u in (lambda x: x > 0.52, lambda x: x < 0.45))
    assert hidden.weight[dark].max() <= 1e-4
    np.testing.assert_array_equal(hidden.weight[light], usual.weight[light])
    strong, _ = placed(sheet(), controls=painted(strength=right(1.0)))
    np.testing.assert_array_equal(strong.weight, usual.weight)


def in_patches(region: str, **changes: float | str) -> tuple[NDArray[np.float64], Events, Factors]:
    """How many times as high events are with patches as without, the events, and what fields of
    patches say of bumps there."""
    surface, settings = Surface.of(sheet()), replace(SETTINGS, region=region, **changes)
    patches = Patches.of(surface, settings, None)
    patched = fields_of(surface, settings, None, None, patches)
    even = events_of(surface, fields_of(surface, settings, None), settings, SPACING)
    found = events_of(surface, patched, settings, SPACING)
    assert even is not None
    assert found is not None
    np.testing.assert_array_equal(found.points.position, even.points.position)
    at = even.points.triangle, even.points.uv
    return found.weight.astype(np.float64) / even.weight, even, patched.event_patches(*at)


def test_bumps_of_a_neck_are_lower_in_quiet_patches_and_moles_are_not() -> None:
    ratio, events, factor = in_patches("neck", events=8.0)
    power = np.array([0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0])[events.kind]
    assert len(np.unique(power)) == 3
    np.testing.assert_allclose(ratio, factor**power, rtol=1e-5)
    bumps = factor[events.kind == EVENT_NAMES.index("bump") + 1]
    assert bumps.min() < 0.6
    assert 1.2 < bumps.max() < 1.41


def test_events_of_other_regions_and_of_coarse_anatomy_follow_no_patches() -> None:
    for region in ("cheek", "forehead", "mouth"):
        assert (in_patches(region)[0] == 1.0).all()
    assert (in_patches("neck", anatomy="coarse")[0] == 1.0).all()


def test_none_lies_on_bare_skin() -> None:
    events, _ = placed(sheet(), controls=painted(density=right(0.0)))
    assert events.points.uv[:, 0].max() < 0.52


def test_young_skin_has_papules_and_old_skin_moles() -> None:
    young, old = (placed(sheet(), replace(SETTINGS, events=4.0, age=a))[0] for a in (20.0, 65.0))
    papule, mole = (EVENT_NAMES.index(name) + 1 for name in ("papule", "mole"))
    assert (young.kind == papule).sum() > 3 * (old.kind == papule).sum()
    assert (young.kind == mole).sum() <= (old.kind == mole).sum()


def test_what_lies_over_a_mole_fades() -> None:
    events, _ = placed(sheet())
    surface, mole = Surface.of(sheet()), EVENT_NAMES.index("mole") + 1
    bump = EVENT_NAMES.index("bump") + 1
    factor = events.fading(surface, events.points.triangle, events.points.uv)
    np.testing.assert_allclose(factor[events.kind == mole], 1.0 - EVENTS["mole"].fading, atol=1e-3)
    assert (factor[events.kind == bump] == 1.0).mean() > 0.9


def test_what_is_near_any_place_is_told_from_what_is_not() -> None:
    """Also beyond the grid, which ends near the outermost of the places."""
    rng = np.random.default_rng(3)
    for spread, reach in ((np.array([1.0, 1.0, 0.2]), 0.03), (np.array([1.0, 0.0, 0.0]), 0.001)):
        centres = spread * rng.random((30, 3))
        near = centres[rng.integers(0, 30, 3000)] + reach * rng.normal(size=(3000, 3))
        asked = np.concatenate([near, 3.0 * rng.random((20_000, 3)) - 1.0])
        some = Around(centres, reach).near(asked)
        assert (np.diff(some) > 0).all()
        within = np.flatnonzero(cKDTree(centres).query(asked)[0] <= reach)
        assert len(within) > 500
        assert set(within) <= set(some)
        assert len(some) < 0.4 * len(asked)


def test_lines_fade_over_the_nearest_event() -> None:
    events, _ = placed(sheet())
    surface, rng = Surface.of(sheet()), np.random.default_rng(6)
    triangle = rng.integers(0, len(surface.uv), 5000)
    shares = rng.dirichlet((1.0, 1.0, 1.0), 5000)
    uv = np.einsum("nc,ncu->nu", shares, surface.uv[triangle]).astype(np.float32)
    most = np.array([0.0, *(event.fading for event in EVENTS.values())])[events.kind]
    over = np.flatnonzero(most > 0.0)
    apart, nearest = cKDTree(events.points.position[over]).query(surface.place(triangle, uv))
    nearest = over[nearest]
    inside = np.maximum(1.0 - (apart / events.radius[nearest]) ** 4, 0.0)
    found = events.fading(surface, triangle, uv)
    assert (found < 1.0).sum() > 20
    np.testing.assert_allclose(found, 1.0 - most[nearest] * inside, rtol=1e-6)


def test_events_change_no_pore_and_no_line_but_where_they_fade(device: Device) -> None:
    mesh, settings = sheet(), GraphSettings(wrinkles=6000, rank=0.0, patches=0.0)
    without, graph = (
        synthesize(mesh, replace(settings, events=n), device).graph for n in (0.0, 4.0)
    )
    assert without.node_kind is None
    assert graph.node_kind is not None
    pores = np.flatnonzero(graph.node_kind == 0)
    np.testing.assert_array_equal(graph.node_uv[pores], without.node_uv)
    np.testing.assert_array_equal(graph.edge_half_width, without.edge_half_width)
    same = graph.edge_weight == without.edge_weight
    assert 0.9 < same.mean() < 1.0
    assert (graph.edge_weight[~same] < without.edge_weight[~same]).all()
    assert graph.counts() == without.counts()


def test_events_over_a_seam_are_copied(device: Device) -> None:
    mesh, settings = tube(), GraphSettings(wrinkles=9000, events=4.0, rank=0.0, patches=0.0)
    graph = synthesize(mesh, settings, device).graph
    assert graph.node_kind is not None
    assert graph.node_copy_of is not None
    copies = np.flatnonzero((graph.node_kind > 0) & (graph.node_copy_of != ORIGINAL))
    first = graph.node_copy_of[copies]
    assert len(copies) > 0
    np.testing.assert_array_equal(graph.node_kind[copies], graph.node_kind[first])
    np.testing.assert_array_equal(graph.node_weight[copies], graph.node_weight[first])
    at = places(Surface.of(mesh), graph)
    assert np.linalg.norm(at[copies] - at[first], axis=1).max() < 0.2
    assert sum(graph.event_counts().values()) == (graph.node_kind > 0).sum() - len(copies)


def test_figures_count_no_event_as_a_pore(device: Device) -> None:
    mesh, settings = sheet(), GraphSettings(wrinkles=3000, rank=0.0, patches=0.0)
    without, graph = (
        synthesize(mesh, replace(settings, events=n), device).graph for n in (0.0, 4.0)
    )
    found, expected = (statistics(mesh, one, device) for one in (graph, without))
    assert found["events"] == graph.event_counts() != {}
    assert expected["events"] == {}
    for name in ("pores", "drawn_pores", "copied_pores", "distance", "degree"):
        assert found[name] == expected[name], name
    triangle = graph.node_triangle
    assert triangle is not None
    assert without.node_triangle is not None
    spacings = (
        mean_spacing(mesh, graph, triangle),
        mean_spacing(mesh, without, without.node_triangle),
    )
    assert spacings[0] == spacings[1]


def test_a_file_holds_the_kinds(device: Device) -> None:
    settings = GraphSettings(wrinkles=3000, events=4.0, rank=0.0, patches=0.0)
    graph = synthesize(sheet(), settings, device).graph
    found = read_graph(write_graph(graph))
    np.testing.assert_array_equal(found.node_kind, graph.node_kind)
    assert found.event_counts() == graph.event_counts()


def test_the_preset_paper_has_no_events() -> None:
    assert AssetSettings.parse({"preset": "paper"}).graph.events == 0.0
    assert AssetSettings.parse({}).graph.events == 1.0


def apart(gap: float) -> Mesh:
    """A sheet in two charts, side by side in the map with a gutter `gap` between them; the right
    one is elsewhere in space."""
    left = sheet(n=12)
    faces = np.concatenate([left.faces, left.faces + len(left.positions)])
    uv = (left.uv - left.uv.min(axis=0)) / np.ptp(left.uv) * np.float32(0.5 - 0.5 * gap)
    moved = left.positions + np.array([0.0, 0.0, 3.0], np.float32)
    shifted = uv + np.array([0.5 + 0.5 * gap, 0.0], np.float32)
    positions, both = np.concatenate([left.positions, moved]), np.concatenate([uv, shifted])
    return Mesh(positions, faces, both, faces)


def over_other_charts(mesh: Mesh, events: Events) -> NDArray[np.bool_]:
    """Whether a rim, in the map, goes over the middle between the charts and the gutter beside."""
    gap = 2.0 * (mesh.uv[mesh.uv[:, 0] > 0.5, 0].min() - 0.5)
    uu, uv, vv = events.metric.astype(np.float64).T
    half = np.sqrt(vv / (uu * vv - uv**2))  # of the width of the ellipse
    beyond = np.abs(events.points.uv[:, 0] - 0.5) - 0.5 * gap
    found: NDArray[np.bool_] = half > beyond + gap
    return found


def test_no_event_reaches_over_a_gutter_into_another_chart() -> None:
    settings = replace(SETTINGS, events=20.0)
    free, _ = placed(apart(0.2), settings)
    assert not over_other_charts(apart(0.2), free).any()
    near, _ = placed(apart(0.002), settings)
    assert 0.9 * len(free) < len(near) < len(free)
    assert not over_other_charts(apart(0.002), near).any()


def test_an_event_at_a_seam_of_charts_that_lie_together_stays() -> None:
    """Where the other chart is skin around it, what it covers there is its own."""
    mesh = sheet(n=12)
    corner = mesh.faces.reshape(-1)
    soup = np.arange(len(corner), dtype=np.int32).reshape(-1, 3)
    split = Mesh(mesh.positions[corner], soup, mesh.uv[corner], soup)
    (whole, at), (parts, there) = placed(mesh), placed(split)
    assert rows(parts, there) == rows(whole, at)
