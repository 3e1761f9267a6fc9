"""What is painted changes itself and its surroundings, and nothing else: bit for bit."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import face_data
from engine.engines import assembled, built, running
from pipeline.scenes import settings_of
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.pore_density import SPACING
from rhytid_lab.samples.face import procedural_face
from synthesis import sheets
from synthesis.changes import Painted, beside

pytestmark = pytest.mark.release

# Spacings from what is painted: pores stay where they are beyond the first, and everything stays
# bit for bit beyond the second. docs/artists.md promises 80.
PORES, FAR = 8.0, 60.0
# Each map with a value that is painted, what is elsewhere, and how much of that far it goes.
GROWING = {
    "density": (1.0, 0.5),
    "turn": (0.8, 0.5),
    "direction": (0.3, 0.0),
    "anisotropy": (0.0, 0.5),
    "region_nose": (1.0, 0.0),
    "region_lip": (1.0, 0.0),
}
DRAWN = ("strength", "scale", "pore_radius")
COUNT = 20_000


@cache
def sample() -> Painted:
    """The built-in face, two centimetres of a cheek."""
    mesh = procedural_face().mesh
    return Painted(mesh, cheek(mesh), 2.0, texels=256)


def cheek(mesh: Mesh) -> np.ndarray:
    """A place on the side of +x, half way up."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    front = 0.25 * low + 0.75 * high
    level = mesh.positions - [front[0], 0.55 * low[1] + 0.45 * high[1], high[2]]
    apart = np.hypot(level[:, 0], level[:, 1]) - 0.5 * level[:, 2]
    place: np.ndarray = mesh.positions[apart.argmin()].astype(float)
    return place


def grow(device: Device, mesh: Mesh, count: int, controls: Controls | None = None) -> Synthesis:
    return synthesize(mesh, GraphSettings(wrinkles=count), device, controls=controls)


@cache
def plain(device: Device) -> Synthesis:
    return grow(device, sample().mesh, COUNT)


def controls(painted: Painted, name: str, value: float, elsewhere: float) -> Controls:
    return Controls({name: {1001: painted.map(value, elsewhere)}})


@pytest.mark.slow
@pytest.mark.parametrize("name", GROWING)
def test_what_grows_by_a_map_changes_nearby_alone(device: Device, name: str) -> None:
    before = plain(device)
    after = grow(device, sample().mesh, COUNT, controls(sample(), name, *GROWING[name]))
    # Depth and widths are meant in spacings: these must not move either.
    assert after.spacing == before.spacing
    reach = sample().reach(before.graph, after.graph, before.spacing)
    assert reach.pores < PORES
    assert 3.0 < reach.anything < FAR
    assert 0.0 < reach.share < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWN)
def test_what_is_drawn_by_a_map_changes_where_it_is_painted(device: Device, name: str) -> None:
    before = plain(device)
    after = grow(device, sample().mesh, COUNT, controls(sample(), name, 1.0, 0.5))
    reach = sample().reach(before.graph, after.graph, before.spacing)
    assert (reach.pores, reach.wrinkles) == (0.0, 0.0)
    assert 0.0 < reach.anything < 2.5


@pytest.mark.slow
def test_bare_skin_leaves_the_rest_as_it_is(device: Device) -> None:
    before = plain(device)
    after = grow(device, sample().mesh, COUNT, controls(sample(), "density", 0.0, 0.5))
    reach = sample().reach(before.graph, after.graph, before.spacing)
    assert reach.pores < PORES
    assert reach.anything < FAR


@pytest.mark.slow
def test_half_a_face_painted_leaves_the_far_side_as_it_is(device: Device) -> None:
    half = Painted(sample().mesh, np.array([100.0, 0.0, 0.0]), 198.0)
    before = plain(device)
    after = grow(device, half.mesh, COUNT, controls(half, "density", 1.0, 0.5))
    assert after.graph.wrinkles > 1.5 * COUNT
    reach = half.reach(before.graph, after.graph, before.spacing)
    assert reach.pores < PORES
    assert reach.anything < FAR
    away = half.away(sheets.places(half.surface, before.graph) * half.surface.scale)
    assert away.max() > FAR * before.spacing / 2


@pytest.mark.slow
def test_a_second_patch_changes_nothing_of_the_first(device: Device) -> None:
    one = sample()
    other = Painted(one.mesh, cheek(one.mesh) * [-1, 1, 1], 2.0, texels=256)
    texels = one.map(1.0, 0.5)
    both = np.where(other.texels, np.float32(0.8), texels)
    first, second = (
        grow(device, one.mesh, COUNT, Controls({"density": {1001: m}})) for m in (texels, both)
    )
    reach = other.reach(first.graph, second.graph, first.spacing)
    assert reach.pores < PORES
    assert 3.0 < reach.anything < FAR


@pytest.mark.slow
def test_the_far_cheek_is_the_same_map(tmp_path: Path) -> None:
    painted, query = sample(), MapQuery("neutral")
    settings = settings_of(graph={"wrinkles": COUNT}, resolution=512, tile_size=256)
    maps = []
    with running(tmp_path) as engine:
        for guided in (None, controls(painted, "density", 1.0, 0.5)):
            asset = built(engine, NewAsset(painted.mesh, settings, controls=guided))
            maps.append(assembled(engine, asset, "neutral", query, 1001, 0))
    spots = Painted(painted.mesh, cheek(painted.mesh), 2.0, texels=512)
    there = np.abs(spots.places - cheek(painted.mesh) * [-1, 1, 1]).max(axis=2) < 1.0
    one, two = (map[there] for map in maps)
    assert one.std() > 0
    assert one.tobytes() == two.tobytes()
    assert np.corrcoef(one, two)[0, 1] == pytest.approx(1.0)
    patch = [map[spots.texels] for map in maps]
    assert np.corrcoef(*patch)[0, 1] < 0.5


def at_radius(device: Device, mesh: Mesh, radius: float) -> WrinkleGraph:
    """Skin of pores at least `radius` apart, in mesh units, through the setting of their mean
    distance."""
    settings = GraphSettings(spacing=SPACING * radius, seed=3)
    return synthesize(mesh, settings, device).graph


@pytest.mark.slow
@pytest.mark.parametrize(
    ("uv", "side", "size"),
    [((1.0, 0.0), 0.4, 1.0), ((0.0, 3.0), 0.9, 12.0), ((0.05, 0.91), 0.08, 2.0)],
)
def test_one_more_chart_changes_nothing_of_the_others(
    device: Device, uv: tuple[float, float], side: float, size: float
) -> None:
    one = sheets.tube()
    extra = sheets.sheet(lambda xy: side * xy, scale=size)
    more = beside(one, extra, uv, np.array([-70.0, 3.0, 11.0]))
    first, second = (at_radius(device, mesh, 0.07) for mesh in (one, more))
    assert second.node_triangle is not None
    mine = second.node_triangle < len(one.faces)
    count = int(np.count_nonzero(first.node_weight))
    assert np.count_nonzero(mine & (second.node_weight > 0)) == count > 2000
    # Numbers of pores follow their place in space: they are matched by their place in the map.
    old, new = (_rows(graph, len(one.faces)) for graph in (first, second))
    assert len(new) > count
    assert old == new
    old, new = (_copies(graph, len(one.faces)) for graph in (first, second))
    assert len(old) > 20
    np.testing.assert_allclose(old, new, rtol=0, atol=1e-6)


def _copies(graph: WrinkleGraph, triangles: int) -> np.ndarray:
    """(K, 7) the copies of pores on the first triangles that are drawn, sorted. What is mapped to
    another chart is rounded by libraries in blocks: its last digits hang on how much there is."""
    assert graph.node_triangle is not None
    assert graph.node_copy_of is not None
    assert graph.node_metric is not None
    uu, _, vv = graph.node_metric.T.astype(float)
    across = np.sqrt(uu * vv)[:, None]
    rows = np.column_stack(
        [graph.node_uv, graph.node_weight, graph.node_radius, graph.node_metric / across]
    )
    rows = rows[
        (graph.node_triangle < triangles) & (graph.node_copy_of >= 0) & (graph.node_weight > 0)
    ]
    return rows[np.lexsort(rows[:, :2].T)]


def _rows(graph: WrinkleGraph, triangles: int) -> set[bytes]:
    """What the pores and wrinkles on the first triangles are, all their bits. But for copies: one
    that would lie on another chart is left out."""
    assert graph.node_triangle is not None
    assert graph.edge_triangle is not None
    assert graph.node_metric is not None
    assert graph.node_copy_of is not None
    assert graph.edge_copy_of is not None
    uv, ends = graph.node_uv, graph.edge_nodes
    pores = np.column_stack([uv, graph.node_weight, graph.node_radius, graph.node_metric])
    lines = np.column_stack([uv[ends[:, 0]], uv[ends[:, 1]], graph.edge_weight,
                             graph.edge_half_width])  # fmt: skip
    pores = pores[(graph.node_triangle < triangles) & (graph.node_copy_of == ORIGINAL)]
    lines = lines[(graph.edge_triangle < triangles) & (graph.edge_copy_of == ORIGINAL)]
    return {row.tobytes() for rows in (pores, lines) for row in rows.astype(np.float32)}


def test_the_spacing_alone_gives_as_many_wrinkles_as_are_usual(device: Device) -> None:
    mesh = sheets.sheet()
    graph = at_radius(device, mesh, 0.008)
    even = 0.605 / 0.008**2
    assert graph.pores == pytest.approx(even, rel=0.01)
    assert graph.wrinkles == pytest.approx(2.1 * even, rel=0.015)


@pytest.mark.slow
@pytest.mark.face
@pytest.mark.parametrize("name", ["density", "direction", "region_nose"])
def test_a_patch_on_the_real_face(device: Device, face: face_data.Face, name: str) -> None:
    painted, before = real(device)
    after = grow(device, painted.mesh, 60_000, controls(painted, name, *GROWING[name]))
    reach = painted.reach(before.graph, after.graph, before.spacing)
    assert reach.pores < PORES
    assert 3.0 < reach.anything < FAR
    assert 0.0 < reach.share < 0.1
    places = sheets.places(painted.surface, before.graph) * painted.surface.scale
    assert np.mean(painted.away(places) > FAR * before.spacing) > 0.2


@cache
def real(device: Device) -> tuple[Painted, Synthesis]:
    """The real face, and its skin with nothing painted."""
    face = face_data.load_face()
    mesh = Mesh(face.positions, face.faces, face.uv.astype(np.float64), face.face_uv)
    return Painted(mesh, cheek(mesh), 2.0), grow(device, mesh, 60_000)
