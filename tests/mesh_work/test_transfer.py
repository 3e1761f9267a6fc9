"""A graph on another mesh draws what it drew on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh
from rhytid.cli.preview import resident
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, GraphSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph, mesh_digest
from rhytid.domain.graph_geometry import node_places
from rhytid.domain.mesh import Mesh
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.errors import GraphError
from rhytid.meshes.transfer import transfer
from rhytid.synthesis.generate import synthesize

R = 512
DEPTH = 0.01
# Of neutral heights, in depths: the most that a picture may differ where nothing was lost, and the
# root of the mean square. At seams the frames of charts follow from the triangles around them:
# 0.011 and 0.0004 were measured on the mesh itself, 0.022 and 0.0012 on the one that is cut up.
SAME, SAME_RMS = 0.03, 0.002


@pytest.fixture(scope="module")
def mesh(small_mesh: SmallMesh) -> Mesh:
    return Mesh(*small_mesh)


@pytest.fixture(scope="module")
def graph(mesh: Mesh, device: Device) -> WrinkleGraph:
    """Bent wrinkles, some of them over the seam, with copies of what reaches over it."""
    with device.task():
        made = synthesize(mesh, GraphSettings(wrinkles=600, seed=3, patches=0.0), device)
    assert made.graph.edge_copy_of is not None
    return replace(made.graph, origin=GraphOrigin.of(mesh, "cm", made.lengths))


def drawn(device: Device, mesh: Mesh, graph: WrinkleGraph) -> NDArray[np.float64]:
    """(R, R) the neutral map in depths."""
    changed = {"resolution": R, "depth": DEPTH, "shape": {"grain": 0, "undulation": 0}}
    settings = AssetSettings().for_graph(graph.origin).changed(changed)
    with resident(device, mesh, graph, settings) as asset:
        heights = asset.drawing.to_host(NEUTRAL_FRAME, MapQuery("neutral"), 1001, 0, 0, 0, R)
    return np.asarray(heights, np.float64) / DEPTH


def cut_up(mesh: Mesh, seed: int = 0) -> Mesh:
    """The same surface and UV of four times as many triangles, everything in another order."""
    rng = np.random.default_rng(seed)
    corners, uv = mesh.positions[mesh.faces].astype(np.float64), mesh.triangle_uv()
    parts = [], []
    for whole, quarter in zip((corners, uv), parts, strict=True):
        a, b, c = np.moveaxis(whole, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)):
            quarter.append(np.stack(t, axis=1))
    order = rng.permutation(4 * len(mesh.faces))
    points, face = np.unique(
        np.concatenate(parts[0])[order].reshape(-1, 3), axis=0, return_inverse=True
    )
    places, face_uv = np.unique(
        np.concatenate(parts[1])[order].reshape(-1, 2), axis=0, return_inverse=True
    )
    shuffled = rng.permutation(len(points))
    back = np.argsort(shuffled)
    return Mesh(points[shuffled], back[face.reshape(-1, 3)], places, face_uv.reshape(-1, 3))


def planar(mesh: Mesh) -> Mesh:
    """The same surface in one chart, seen from above: no seam, other sizes and shapes in UV."""
    uv = mesh.positions[:, :2].astype(np.float64) * (0.24, 0.2) + (0.5, 0.5)
    return Mesh(mesh.positions, mesh.faces, uv, mesh.faces)


def check_same(one: NDArray[np.float64], two: NDArray[np.float64]) -> None:
    assert np.abs(one).max() > 0.5
    assert np.abs(one - two).max() < SAME
    assert np.sqrt(np.mean((one - two) ** 2)) < SAME_RMS


@pytest.mark.parametrize("change", [lambda m: m, cut_up], ids=["itself", "cut up"])
def test_the_same_surface_gives_the_same_picture(
    device: Device, mesh: Mesh, graph: WrinkleGraph, change: object
) -> None:
    other = change(mesh)  # type: ignore[operator]
    moved = transfer(graph, mesh, other)

    assert moved.graph.counts() == graph.counts()
    assert (moved.far, moved.averse, moved.unheld, moved.lost, moved.torn) == (0, 0, 0, 0, 0)
    assert moved.over_seams > 10
    assert moved.distance[1] < 1e-6
    check_same(drawn(device, mesh, graph), drawn(device, other, moved.graph))


def test_origin_is_that_of_the_other_mesh(mesh: Mesh, graph: WrinkleGraph) -> None:
    other = cut_up(mesh)
    origin = transfer(graph, mesh, other).graph.origin

    assert graph.origin is not None
    assert origin == replace(graph.origin, mesh=mesh_digest(other))


def test_to_another_layout_and_back(device: Device, mesh: Mesh, graph: WrinkleGraph) -> None:
    """Seams are lost on the way there, and the copies over them are made again on the way back."""
    other = planar(mesh)
    there = transfer(graph, mesh, other)
    again = transfer(there.graph, other, mesh)

    assert there.over_seams == 0
    assert there.graph.edge_copy_of is None
    assert again.over_seams > 10
    assert again.graph.counts() == graph.counts()
    check_same(drawn(device, mesh, graph), drawn(device, mesh, again.graph))


def test_sizes_are_those_on_the_surface(mesh: Mesh, graph: WrinkleGraph) -> None:
    """On a sheet that lies in UV at half the size in one direction alone."""
    other = planar(mesh)
    half = replace(other, uv=other.uv * (0.5, 1.0))
    one, two = (transfer(graph, mesh, to).graph for to in (other, half))

    along = np.diff(one.node_uv[one.edge_nodes].astype(np.float64), axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    wanted = one.edge_half_width * 0.5 * length / np.linalg.norm(along * (0.5, 1.0), axis=1)
    assert two.edge_half_width == pytest.approx(wanted, rel=1e-4)
    assert one.node_metric is not None
    assert two.node_metric is not None
    assert two.node_metric == pytest.approx(one.node_metric * (4, 2, 1), rel=1e-3)


def test_mirrored_uv_bend_the_other_way(mesh: Mesh, graph: WrinkleGraph) -> None:
    other = planar(mesh)
    mirrored = replace(other, uv=(1.0, 0.0) + other.uv * (-1.0, 1.0))
    one, two = (transfer(graph, mesh, to).graph for to in (other, mirrored))

    assert one.edge_slopes is not None
    assert two.edge_slopes == pytest.approx(-one.edge_slopes, abs=1e-4)
    assert np.abs(one.edge_slopes).max() > 0.1


def test_a_head_nearby_has_the_pores_at_their_places(mesh: Mesh, graph: WrinkleGraph) -> None:
    """Moved by a hundredth of its size and larger by as much."""
    near = replace(cut_up(mesh), positions=cut_up(mesh).positions * np.float32(1.01))
    near = replace(near, positions=near.positions + np.array([0, 0, 0.02], np.float32))
    moved = transfer(graph, mesh, near, reach=0.05)

    pores, kept = graph.counts()[0], moved.graph.counts()[0]
    assert kept == pores - moved.far - moved.averse - moved.unheld
    assert kept > 0.97 * pores
    own = np.flatnonzero(moved.graph.own_nodes & (moved.graph.node_weight > 0))
    before = node_places(mesh, graph, np.flatnonzero(graph.own_nodes & (graph.node_weight > 0)))
    after = node_places(near, moved.graph, own)
    assert len(own) == len(before)
    assert np.linalg.norm(after - before, axis=1).max() < 0.05
    assert 0.005 < moved.distance[0] < moved.distance[1] < 0.05


def test_what_is_too_far_is_dropped_and_counted(mesh: Mesh, graph: WrinkleGraph) -> None:
    left = np.flatnonzero((mesh.positions[mesh.faces][:, :, 0] < 1e-6).all(axis=1))
    part = replace(mesh, faces=mesh.faces[left], face_uv=mesh.face_uv[left])
    moved = transfer(graph, mesh, part, reach=0.02)

    assert moved.far > 0.3 * graph.counts()[0]
    assert moved.lost + moved.torn + moved.graph.counts()[1] == graph.counts()[1]
    kept, before = (int(g.own_nodes.sum()) for g in (moved.graph, graph))
    assert kept + moved.far + moved.averse + moved.unheld == before
    assert moved.distance[1] <= 0.02
    (wider,) = (transfer(graph, mesh, part, reach=5.0),)
    assert wider.far == 0
    assert wider.torn > 0


def test_the_other_side_of_a_fold_is_not_taken(mesh: Mesh, graph: WrinkleGraph) -> None:
    over = replace(mesh, faces=mesh.faces[:, ::-1], face_uv=mesh.face_uv[:, ::-1])

    with pytest.raises(GraphError, match="no wrinkle can be carried"):
        transfer(graph, mesh, over)


def test_a_mesh_elsewhere_is_refused(mesh: Mesh, graph: WrinkleGraph) -> None:
    away = replace(mesh, positions=mesh.positions + np.float32(9))

    with pytest.raises(GraphError, match=r"pores \d+ are more than 0.04 .* one place and unit"):
        transfer(graph, mesh, away)


def test_centres_are_put_back(mesh: Mesh, graph: WrinkleGraph) -> None:
    """One of both was brought to the origin: they lie in one place all the same."""
    far = replace(mesh, centre=np.array([100.0, 0, 0]))
    there = replace(mesh, positions=mesh.positions + np.array([100, 0, 0], np.float32))

    assert transfer(graph, far, there).far == 0
    assert transfer(graph, there, far).far == 0


def test_graphs_with_the_required_arrays_alone_stay_plain(mesh: Mesh, graph: WrinkleGraph) -> None:
    names = ("edge_slopes", "edge_end_weights", "edge_end_half_widths", "edge_partners")
    bare = replace(graph, origin=None, **dict.fromkeys(names))
    moved = transfer(bare, mesh, cut_up(mesh)).graph

    assert all(getattr(moved, name) is None for name in names)
    with pytest.raises(GraphError, match="node_triangle"):
        transfer(replace(bare, node_triangle=None), mesh, mesh)


def test_partners_and_factors_of_nodes_follow(mesh: Mesh, graph: WrinkleGraph) -> None:
    """A wrinkle that is gone is nobody's partner; the others still go on in each other."""
    grain = np.linspace(0, 4, graph.pores).astype(np.float32)
    factors = {
        "node_grain": grain,
        "node_undulation": 16 - grain,
        "node_patchiness": grain[::-1],
    }
    moved = transfer(replace(graph, **factors), mesh, cut_up(mesh)).graph

    assert moved.edge_partners is not None
    assert graph.edge_partners is not None
    own = np.flatnonzero(moved.own_edges)
    before = np.flatnonzero(graph.own_edges)
    assert len(own) == len(before)
    assert np.array_equal(moved.edge_partners[own] >= 0, graph.edge_partners[before] >= 0)
    pores = np.flatnonzero(graph.own_nodes)
    assert moved.node_grain is not None
    assert moved.node_undulation is not None
    assert np.array_equal(moved.node_grain[: len(pores)], grain[pores])
    assert np.array_equal(moved.node_undulation, 16 - moved.node_grain)
    assert moved.node_patchiness is not None
    assert np.array_equal(moved.node_patchiness[: len(pores)], grain[::-1][pores])
    copies = np.flatnonzero(~moved.own_nodes)
    assert moved.node_copy_of is not None
    assert len(copies)


def test_shares_follow_and_copies_have_those_of_their_originals(
    mesh: Mesh, graph: WrinkleGraph
) -> None:
    share = np.linspace(0, 3, graph.wrinkles).astype(np.float32)
    moved = transfer(replace(graph, edge_share=share), mesh, cut_up(mesh)).graph

    assert moved.edge_share is not None
    assert moved.edge_copy_of is not None
    own, copies = np.flatnonzero(moved.own_edges), np.flatnonzero(~moved.own_edges)
    assert np.array_equal(moved.edge_share[own], share[graph.own_edges])
    assert len(copies)
    assert np.array_equal(moved.edge_share[copies], moved.edge_share[moved.edge_copy_of[copies]])
    assert transfer(graph, mesh, mesh).graph.edge_share is None


def test_arcs_at_seams_stay_as_they_are(mesh: Mesh, graph: WrinkleGraph) -> None:
    """Slopes there are meant where footprints are round, before and after."""
    moved = transfer(graph, mesh, mesh).graph
    own = np.flatnonzero(graph.own_edges)
    assert moved.edge_metric is not None
    assert graph.edge_metric is not None
    both = own[graph.edge_metric[own].any(axis=1) & moved.edge_metric[: len(own)].any(axis=1)]

    assert len(both) > 50
    assert moved.edge_slopes is not None
    assert graph.edge_slopes is not None
    gaps = np.abs(moved.edge_slopes[np.searchsorted(own, both)] - graph.edge_slopes[both])
    assert np.quantile(gaps, 0.9) < 1e-4


def test_partners_that_are_copies_count_as_what_they_copy(mesh: Mesh, graph: WrinkleGraph) -> None:
    assert graph.edge_partners is not None
    assert graph.edge_copy_of is not None
    copy_of = np.arange(graph.wrinkles)
    copies = np.flatnonzero(~graph.own_edges)
    copy_of[graph.edge_copy_of[copies]] = copies
    named = np.where(graph.edge_partners >= 0, copy_of[graph.edge_partners], -1)
    one, two = (
        transfer(replace(graph, edge_partners=partners), mesh, mesh).graph.edge_partners
        for partners in (graph.edge_partners, named)
    )

    assert (named != graph.edge_partners).any()
    assert one is not None
    assert two is not None
    assert np.array_equal(one, two)


def test_events_are_carried_with_their_kinds(mesh: Mesh, device: Device) -> None:
    with device.task():
        made = synthesize(mesh, GraphSettings(wrinkles=600, seed=3, events=4.0), device).graph
    assert made.node_kind is not None
    moved = transfer(made, mesh, cut_up(mesh)).graph
    assert moved.event_counts() == made.event_counts() != {}
    assert moved.counts()[0] == made.counts()[0]
