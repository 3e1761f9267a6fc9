"""Candidate wrinkles, lines on the map with few crossings, and independent sets of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from reference.synthesis import pairs_in_sight
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.synthesis.edges import LEAST_ANGLE, REACH, WAYS, candidates, crossings
from rhytid.synthesis.incidence import independent_set
from rhytid.synthesis.progress import silent
from rhytid.synthesis.seams.charts import BORDER, neighbours, trace
from rhytid.synthesis.surface import FloatArray, Points, Surface
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

RADIUS = 0.04


def test_a_sheet_has_a_border_and_whole_insides() -> None:
    across = neighbours(sheets.sheet(n=4))
    assert np.count_nonzero(across == BORDER) == 16
    for triangle, others in enumerate(across):
        assert all(triangle in across[other] for other in others if other != BORDER)


def test_repeated_uv_is_no_seam_but_other_uv_is() -> None:
    mesh = sheets.sheet(n=2)
    apart = np.arange(mesh.face_uv.size).reshape(-1, 3)
    repeated = Mesh(mesh.positions, mesh.faces, mesh.triangle_uv().reshape(-1, 2), apart)
    assert (neighbours(repeated) == neighbours(mesh)).all()
    split = Mesh(mesh.positions, mesh.faces, repeated.uv + 1e-9 * np.arange(24)[:, None], apart)
    assert (neighbours(split) == BORDER).all()


def test_a_line_is_followed_to_its_end_or_to_the_border() -> None:
    mesh = sheets.sheet(n=8)
    surface = Surface.of(mesh)
    start = np.array([0, 0])
    origin = np.repeat(surface.uv[0].mean(axis=0)[None], 2, axis=0)
    step = np.array([[0.5, 0.37], [1.6, 0.4]])
    line = trace(surface, neighbours(mesh), start, origin, step)
    assert line.share[0] == 1.0
    assert line.length[0] == pytest.approx(np.hypot(0.5, 0.37) / 0.8)
    # The border is at u = 0.9.
    assert origin[1, 0] + line.share[1] * 1.6 == pytest.approx(0.9)
    assert surface.uv[line.end[0]].mean(axis=0) == pytest.approx(origin[0] + step[0], abs=0.08)
    assert surface.uv[line.middle[0]].mean(axis=0) == pytest.approx(
        origin[0] + 0.5 * step[0], abs=0.08
    )


def test_edges_join_each_pore_to_its_neighbours_once(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.sheet(sheets.uneven), RADIUS)
    assert (edges.nodes[:, 0] < edges.nodes[:, 1]).all()
    assert len(np.unique(edges.nodes, axis=0)) == len(edges)
    assert (np.diff(edges.nodes[:, 0]) >= 0).all()
    ends = pores.position[edges.nodes]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1) == pytest.approx(edges.length, rel=1e-6)
    assert 2.5 < len(edges) / len(pores) < 3.5


@pytest.mark.parametrize("crowded", [1.0, 1.45])
def test_edges_join_what_is_in_sight_however_many_are_near(device: Device, crowded: float) -> None:
    mesh, radius = sheets.sheet(), 0.1
    pores = sheets.scattered(device, mesh, radius / crowded)
    with Workspace(device) as work:
        edges, nearest = candidates(
            work, Surface.of(mesh), neighbours(mesh), pores, radius, 8, silent
        )
    wanted = pairs_in_sight(pores.position, pores.normal, 8, REACH * radius, LEAST_ANGLE)
    found = set(map(tuple, edges.nodes.tolist()))
    assert found <= wanted
    assert len(found) > 0.98 * len(wanted)
    distance = cKDTree(pores.position).query(pores.position, k=2)[0][:, 1]
    # Places are counted in steps of a 65,536th of the radius.
    assert nearest == pytest.approx(distance, abs=2.0 * radius / 2**16)
    near = [len(n) - 1 for n in cKDTree(pores.position).query_ball_point(pores.position, 0.22)]
    assert max(near) <= WAYS if crowded == 1.0 else np.mean(np.array(near) > WAYS) > 0.5


def test_a_point_beyond_a_crowd_is_joined_too(device: Device) -> None:
    mesh, radius = sheets.sheet(), 0.1
    pores = sheets.scattered(device, mesh, 0.012)
    tree = cKDTree(pores.position[:, :2])
    centre, beyond = tree.query([(0.5, 0.5), (0.34, 0.5)])[1]
    crowd = tree.query_ball_point((0.57, 0.5), 0.035)
    assert len(crowd) > WAYS
    chosen = np.sort([centre, beyond, *crowd])
    few = pores.take(chosen)
    with Workspace(device) as work:
        edges, _ = candidates(work, Surface.of(mesh), neighbours(mesh), few, radius, 16, silent)
    wanted = pairs_in_sight(few.position, few.normal, 16, REACH * radius, LEAST_ANGLE)
    pair = tuple(np.sort(np.searchsorted(chosen, [centre, beyond])).tolist())
    assert pair in wanted
    assert set(map(tuple, edges.nodes.tolist())) == wanted


def test_no_two_edges_leave_a_pore_side_by_side(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.sheet(), RADIUS)
    for pore in range(0, len(pores), 7):
        mine = edges.nodes[(edges.nodes == pore).any(axis=1)]
        way = pores.position[mine.sum(axis=1) - pore, :2] - pores.position[pore, :2]
        angle = np.sort(np.arctan2(way[:, 1], way[:, 0]))
        assert np.diff(angle).min() > np.radians(34.9)


def test_no_edge_crosses_a_hole(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.with_hole(), RADIUS, seed=4)
    middle = pores.uv[edges.nodes].mean(axis=1)
    inside = (np.abs(middle - 0.5) < 0.8 / 6 - 1e-6).all(axis=1)
    assert not inside.any()
    assert (edges.middle != BORDER).all()


def test_no_edge_joins_sheets_that_touch(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.face_to_face(), RADIUS)
    ends = pores.normal[edges.nodes][..., 2]
    assert (ends[:, 0] * ends[:, 1] > 0).all()


def test_edges_cross_a_seam_only_where_the_surface_goes_on(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.tube(), RADIUS)
    seam = edges.middle == BORDER
    assert seam.sum() > 20
    apart = np.abs(pores.uv[edges.nodes[:, 0], 0] - pores.uv[edges.nodes[:, 1], 0])
    assert (apart[seam] > 0.6).all()
    assert (apart[~seam] < 0.1).all()
    # A sheet has borders, but nothing beyond them.
    assert (sheets.net(device, sheets.sheet(), RADIUS)[1].middle != BORDER).all()


def test_crossings_are_found(device: Device) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]], float)
    points = Points(np.zeros(5, int), square[:, :2], square, np.tile([0.0, 0.0, 1.0], (5, 1)))
    nodes = np.array([[0, 2], [1, 3], [0, 1], [2, 4], [3, 4]], np.int32)
    length = np.linalg.norm(square[nodes[:, 0]] - square[nodes[:, 1]], axis=-1)
    with Workspace(device) as work:
        found = crossings(work, points, nodes, length.astype(np.float32))
    assert np.sort(found, axis=1).tolist() == [[0, 1]]


@pytest.mark.parametrize("size", [1.0, 0.99, 0.7])
def test_lines_as_long_as_the_whole_cross_too(device: Device, size: float) -> None:
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    points = Points(np.zeros(4, int), corners[:, :2], corners, np.tile([0.0, 0.0, 1.0], (4, 1)))
    length = np.full(2, size * np.sqrt(2), np.float32)
    with Workspace(device) as work:
        found = crossings(work, points, np.array([[0, 2], [1, 3]], np.int32), length)
    assert np.sort(found, axis=1).tolist() == [[0, 1]]


@pytest.mark.parametrize("turned", [False, True], ids=["near first", "far first"])
def test_a_line_with_one_end_beyond_what_is_near_crosses_too(device: Device, turned: bool) -> None:
    """On a surface whose curve takes the two apart: it is found from the end that is near, whether
    that has the lower number or the higher."""
    other = np.array([[0.5, -0.4, 0.7], [0.5, 0.4, 1.1]])
    place = np.append([[0, 0, 0], [1, 0, 0]], other[::-1] if turned else other, axis=0)
    points = Points(np.zeros(4, int), place[:, :2], place, np.tile([0.0, 0.0, 1.0], (4, 1)))
    nodes = np.array([[0, 1], [2, 3]], np.int32)
    length = np.linalg.norm(place[nodes[:, 0]] - place[nodes[:, 1]], axis=-1).astype(np.float32)
    assert length[1] < length[0] < place[:, 2].max()
    with Workspace(device) as work:
        found = crossings(work, points, nodes, length)
    assert np.sort(found, axis=1).tolist() == [[0, 1]]


@pytest.mark.parametrize("lines", [60, 900])
def test_crossings_are_those_of_every_pair(device: Device, lines: int) -> None:
    """Few lines between many pores, and so many between few that each has hundreds near it."""
    rng = np.random.default_rng(lines)
    place = np.append(rng.random((70, 2)), np.zeros((70, 1)), axis=1)
    points = Points(np.zeros(70, int), place[:, :2], place, np.tile([0.0, 0.0, 1.0], (70, 1)))
    every = np.stack(np.triu_indices(70, 1), axis=1)
    nodes = every[np.sort(rng.choice(len(every), lines, replace=False))].astype(np.int32)
    length = np.linalg.norm(place[nodes[:, 0]] - place[nodes[:, 1]], axis=-1)
    with Workspace(device) as work:
        found = crossings(work, points, nodes, length.astype(np.float32))
    pairs = np.stack(np.triu_indices(lines, 1), axis=1)
    one, two = nodes[pairs[:, 0]], nodes[pairs[:, 1]]
    share_an_end = (one[:, :, None] == two[:, None, :]).any(axis=(1, 2))
    wanted = pairs[~share_an_end & _cross(place[one, :2], place[two, :2])].tolist()
    assert len(wanted) > lines
    assert sorted(np.sort(found, axis=1).tolist()) == wanted


def _cross(one: FloatArray, two: FloatArray) -> NDArray[np.bool_]:
    """(N) whether lines of (N, 2, 2) ends cross: each has its ends on both sides of the other."""

    def sides(line: FloatArray, ends: FloatArray) -> FloatArray:
        along, to = line[:, 1:] - line[:, :1], ends - line[:, :1]
        return np.asarray(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0])

    return (sides(one, two).prod(axis=1) < 0) & (sides(two, one).prod(axis=1) < 0)


# The rounds of the greedy independent set give what the loop gives.
COUNT = 12
items = st.integers(0, COUNT - 1)
conflicts = st.lists(st.tuples(items, items).filter(lambda pair: pair[0] != pair[1]), max_size=40)


keys = st.lists(st.integers(0, 5), min_size=COUNT, max_size=COUNT)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(key=keys, pairs=conflicts)
def test_rounds_equal_the_loop(
    device: Device, key: list[int], pairs: list[tuple[int, int]]
) -> None:
    kept: list[int] = []
    for item in sorted(range(COUNT), key=lambda i: (key[i], i)):
        if not any((item, k) in pairs or (k, item) in pairs for k in kept):
            kept.append(item)
    with Workspace(device) as work:
        found = independent_set(
            work, np.array(key, np.float32), np.array(pairs, np.int32).reshape(-1, 2)
        )
    assert np.flatnonzero(found).tolist() == sorted(kept)
