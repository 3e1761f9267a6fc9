"""What is found of meshes that have one thing wrong, each made by hand."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from meshes import SmallMesh
from rhytid.domain.mesh import Mesh
from rhytid.formats.meshes import MeshFile
from rhytid.meshes.check import MeshCheck
from rhytid.meshes.layout import Layout
from rhytid.meshes.topology import Topology, _Edges, joined


def changed(small: SmallMesh, **arrays: object) -> Mesh:
    return Mesh(**{**small._asdict(), **arrays})  # type: ignore[arg-type]


def with_turned(small: SmallMesh, rows: list[int]) -> Mesh:
    faces, face_uv = small.faces.copy(), small.face_uv.copy()
    for array in (faces, face_uv):
        array[rows] = array[rows][:, ::-1]
    return changed(small, faces=faces, face_uv=face_uv)


def test_a_sheet_is_one_part_with_one_border(small_mesh: SmallMesh) -> None:
    found = Topology.of(Mesh(*small_mesh))

    assert (found.components, found.loops, found.loop_edges.tolist()) == (1, 1, [40])
    assert (found.non_manifold, found.inconsistent, found.twisted) == (0, 0, 0)
    assert not found.flipped.any()
    assert (found.split, found.unused) == (0, 0)
    corners = small_mesh.positions.reshape(11, 11, 3)
    sides = (corners[0], corners[-1], corners[:, 0], corners[:, -1])
    length = sum(np.linalg.norm(np.diff(side, axis=0), axis=1).sum() for side in sides)
    assert found.loop_lengths == pytest.approx([length], rel=1e-6)


def test_a_closed_surface_has_no_border_though_its_vertices_are_split() -> None:
    ball = trimesh.creation.icosphere(2)
    corners = np.asarray(ball.faces).reshape(-1)
    alone = np.arange(len(corners)).reshape(-1, 3)
    uv = np.random.default_rng(0).uniform(0, 1, (len(ball.vertices), 2))
    found = Topology.of(Mesh(ball.vertices, ball.faces, uv, ball.faces))
    split = Topology.of(Mesh(ball.vertices[corners], alone, uv, ball.faces))

    assert found.loops == split.loops == 0
    assert found.components == split.components == 1
    assert (found.split, split.split) == (0, len(corners) - len(ball.vertices))


def test_triangles_turned_over_are_those_found(small_mesh: SmallMesh) -> None:
    # The two of a quad in the middle and, apart from them, one more.
    found = Topology.of(with_turned(small_mesh, [44, 45, 70]))

    assert np.flatnonzero(found.flipped).tolist() == [44, 45, 70]
    assert found.inconsistent == 4 + 3
    assert Topology.of(with_turned(small_mesh, list(range(200)))).inconsistent == 0


def test_a_moebius_strip_is_twisted() -> None:
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.stack(
        [np.cos(turn) * np.cos(turn / 2), np.sin(turn) * np.cos(turn / 2), np.sin(turn / 2)], axis=1
    )
    points = np.concatenate([ring + 0.3 * up, ring - 0.3 * up])
    quads = [(i, i + 12, (i + 1) + 12, i + 1) for i in range(11)] + [(11, 23, 0, 12)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    uv = np.random.default_rng(0).uniform(0, 1, (24, 2))
    found = Topology.of(Mesh(points, faces, uv, faces))

    assert (found.twisted, found.loops, found.flipped.any()) == (1, 1, False)


def test_a_third_triangle_at_an_edge(small_mesh: SmallMesh) -> None:
    edge = small_mesh.faces[44, :2]
    fin = np.array([[*edge, len(small_mesh.positions)]])
    tip = small_mesh.positions[edge].mean(axis=0, keepdims=True) + np.array([0, 0, 0.3])
    found = Topology.of(
        changed(
            small_mesh,
            positions=np.concatenate([small_mesh.positions, tip]),
            faces=np.concatenate([small_mesh.faces, fin]),
            face_uv=np.concatenate([small_mesh.face_uv, small_mesh.face_uv[:1]]),
        )
    )

    assert found.non_manifold == 1
    assert found.at_non_manifold.sum() == 3
    assert found.at_non_manifold[[44, 200]].all()


def test_parts_borders_and_what_no_triangle_uses(small_mesh: SmallMesh) -> None:
    rows = [0, 1, *range(100, 200)]  # a quad of the left half, and the right half
    found = Topology.of(
        changed(small_mesh, faces=small_mesh.faces[rows], face_uv=small_mesh.face_uv[rows])
    )

    assert np.bincount(found.component).tolist() == [100, 2]
    assert found.component[0] == 1
    assert found.loop_edges.tolist() == [30, 4]
    assert found.unused == 121 - 66 - 4


def test_a_narrow_gap_is_a_gap(small_mesh: SmallMesh) -> None:
    """The right half with vertices of its own, a thousandth of the sheet away."""
    gap = np.array([0.002, 0, 0], np.float32)
    both = np.concatenate([small_mesh.positions, small_mesh.positions + gap])
    faces = small_mesh.faces + 121 * (np.arange(200) >= 100)[:, None]

    assert Topology.of(changed(small_mesh, positions=both, faces=faces)).components == 2


def test_triangles_without_area(small_mesh: SmallMesh) -> None:
    faces, face_uv = small_mesh.faces.copy(), small_mesh.face_uv.copy()
    faces[7, 2] = faces[7, 1]
    face_uv[9, 2] = face_uv[9, 1]
    mesh = changed(small_mesh, faces=faces, face_uv=face_uv)

    assert np.flatnonzero(Topology.of(mesh).degenerate).tolist() == [7]
    assert np.flatnonzero(Layout.of(mesh, "cm", 256).flat).tolist() == [9]


def test_overlap_and_mirrored_parts(small_mesh: SmallMesh) -> None:
    """The right chart laid over the left one, mirrored."""
    clean = Layout.of(Mesh(*small_mesh), "cm", 256)
    assert (clean.udims, clean.charts, clean.overlaps) == ((1001,), 2, {})
    assert not clean.overlapping.any()
    assert clean.mirrored_share == 0

    uv = small_mesh.uv.astype(np.float64)
    right = np.unique(small_mesh.face_uv[100:])
    uv[right, 0] = 1.0 - uv[right, 0]
    found = Layout.of(changed(small_mesh, uv=uv), "cm", 256)
    assert found.overlaps[1001].most >= 2
    assert found.overlaps[1001].share > 0.5
    assert found.overlapping.mean() > 0.5
    assert np.array_equal(np.flatnonzero(found.mirrored), np.arange(100, 200))
    assert 0.3 < found.mirrored_share < 0.7


def test_overlapping_triangles_are_told_apart() -> None:
    """Two on top of one another, one beside them."""
    uv = np.array([[0.1, 0.1], [0.4, 0.1], [0.1, 0.4], [0.6, 0.6], [0.9, 0.6], [0.6, 0.9]])
    points = np.pad(uv, ((0, 0), (0, 1)))
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 1, 2]])
    found = Layout.of(Mesh(points, faces, uv, faces), "cm", 256)

    assert found.overlapping.tolist() == [True, False, True]


def test_texels_are_as_large_as_their_triangles_say() -> None:
    """Three lone triangles, 1, 2 and 4 times as large in space as in UV."""
    corner = np.array([[0, 0], [0.2, 0], [0, 0.2]])
    uv = np.concatenate([corner + np.array([0.3 * i, 0.1]) for i in range(3)])
    flat = np.concatenate([corner * 2**i + np.array([9 * i, 0]) for i in range(3)])
    points = np.pad(flat, ((0, 0), (0, 1)))
    faces = np.arange(9).reshape(3, 3)
    found = Layout.of(Mesh(points, faces, uv, faces), "cm", 1024)

    assert found.texels == pytest.approx(np.array([1, 2, 4]) / 1024, rel=1e-6)
    assert found.extremes == (0, 2, 2)


def test_figures_name_places_where_they_were_sent(small_mesh: SmallMesh) -> None:
    mesh = with_turned(small_mesh, [70])
    far = mesh.positions.astype(np.float64) + np.array([10_000.0001, 0, 0])
    away = Mesh.centred(far, mesh.faces, mesh.uv, mesh.face_uv)
    assert away.centre.any()
    figures = MeshCheck.of(MeshFile(away), "mm", 256).figures()

    (place,) = figures["triangles_with"]["flipped"]["places"]
    assert place["triangle"] == 70
    middle = small_mesh.positions[small_mesh.faces[70]].mean(axis=0)
    assert place["at"] == pytest.approx(middle + np.array([10_000, 0, 0]), abs=1e-3)
    assert figures["size"]["longest_mm"] == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("seed", range(30))
def test_parts_are_those_of_trimesh_in_the_same_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(1, 300))
    ends = rng.integers(0, nodes, (int(rng.integers(0, 2 * nodes)), 2))
    expected = trimesh.graph.connected_component_labels(ends, node_count=nodes)
    np.testing.assert_array_equal(joined(ends, nodes), expected)


@pytest.mark.parametrize("order", ["up", "down", "shuffled"])
def test_a_long_chain_is_one_part(order: str) -> None:
    chain = np.arange(20_000)
    if order != "up":
        chain = np.random.default_rng(0).permutation(chain) if order == "shuffled" else chain[::-1]
    assert not joined(np.stack([chain[:-1], chain[1:]], axis=1), len(chain)).any()


def test_edges_and_areas_are_those_of_trimesh(small_mesh: SmallMesh) -> None:
    found = _Edges(Mesh(*small_mesh))
    tri = trimesh.Trimesh(found.points, found.faces, process=False, validate=False)
    np.testing.assert_allclose(found.area, tri.area_faces, rtol=1e-12)
    assert set(map(tuple, found.ends.tolist())) == set(map(tuple, tri.edges_unique.tolist()))
    np.testing.assert_array_equal(found.ends[found.of], tri.edges_sorted)
    np.testing.assert_array_equal(found.triangle, tri.edges_face)
