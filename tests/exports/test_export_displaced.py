"""Subdivided surfaces that are moved by maps, against what they must be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh, deform
from rhytid.baking.map_sources import Geometry
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError, LimitError
from rhytid.exports.displaced import Samples, Subdivided, levels_for
from rhytid.exports.meshes import flat_mesh
from rhytid.exports.textures.frame_map import Padding


def test_without_height_the_surface_stays(small_mesh: SmallMesh) -> None:
    mesh = Mesh(*small_mesh)
    frame = deform(mesh.positions, 3)
    for levels in (0, 1, 3):
        cut = Subdivided.of(mesh, levels)
        found = cut.moved(frame, {1001: np.zeros((8, 8), np.float32)})
        assert len(found.faces) == 200 * 4**levels
        assert np.array_equal(found.positions[: len(frame)], frame)
        corners = found.positions[found.faces].astype(np.float64)
        area = np.linalg.norm(np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), axis=1).sum()
        whole = frame[mesh.faces].astype(np.float64)
        wanted = np.linalg.norm(np.cross(*np.diff(whole, axis=1).swapaxes(0, 1)), axis=1).sum()
        assert area == pytest.approx(wanted, rel=1e-5)
        # Each triangle in its place in UV, too, and turned as it was.
        first = found.uv[found.faces[: 4**levels]].mean(axis=(0, 1))
        assert first == pytest.approx(mesh.triangle_uv()[0].mean(axis=0))


def test_a_flat_sheet_rises_by_its_map() -> None:
    """Heights that are linear in UV come out exactly, at old vertices and at new ones."""
    uv = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])
    points = np.pad(uv * 10, ((0, 0), (0, 1)))
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    cut = Subdivided.of(Mesh(points, faces, uv, faces), 4)
    column, row = np.meshgrid((np.arange(64) + 0.5) / 64, 1 - (np.arange(64) + 0.5) / 64)
    found = cut.moved(points.astype(np.float32), {1001: 0.5 * column + 2 * row})

    wanted = 0.5 * found.uv[:, 0] + 2 * found.uv[:, 1]
    assert found.positions[:, 2] == pytest.approx(wanted, abs=1e-5)
    assert found.positions[:, :2] == pytest.approx(found.uv * 10, abs=1e-5)


def test_seams_stay_closed(small_mesh: SmallMesh) -> None:
    """Both sides of the seam read other places of a map of noise."""
    mesh = Mesh(*small_mesh)
    cut = Subdivided.of(mesh, 2)
    noise = np.random.default_rng(0).normal(0, 0.02, (256, 256))
    still, moved = (cut.moved(mesh.positions, {1001: one}) for one in (0 * noise, noise))

    _, place = np.unique(still.positions, axis=0, return_inverse=True)
    place = place.reshape(-1)
    assert np.bincount(place).max() == 2
    order = np.argsort(place, kind="stable")
    same = np.flatnonzero(np.diff(place[order]) == 0)
    assert len(same) == 10 * 4 + 1
    assert np.array_equal(moved.positions[order[same]], moved.positions[order[same + 1]])
    assert np.abs(moved.positions - still.positions).max() > 0.02


def test_seams_of_vertices_that_came_split_stay_closed(small_mesh: SmallMesh) -> None:
    """As GLB and PLY have them; with a frame that bends the seam."""
    whole = flat_mesh(Mesh(*small_mesh))
    mesh = Mesh(whole.positions, whole.faces, whole.uv, whole.faces)
    assert len(mesh.positions) == 132
    frame = deform(mesh.positions, 5)
    noise = np.random.default_rng(0).normal(0, 0.02, (256, 256))
    cut = Subdivided.of(mesh, 1)
    moved, still = (cut.moved(frame, {1001: one}).positions for one in (noise, 0 * noise))

    one, two = (len(np.unique(found, axis=0)) for found in (moved, still))
    assert one == two == len(moved) - 21


def test_vertices_on_the_border_of_udims_take_their_own_map() -> None:
    """Two squares side by side in space, each filling a UDIM."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    uv = np.concatenate([square, square + np.array([1, 0])])
    points = np.pad(uv + np.repeat([[0, 0], [1, 0]], 4, axis=0), ((0, 0), (0, 1)))
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    maps = {1001: np.full((4, 4), 1.0), 1002: np.full((4, 4), 2.0)}
    found = Subdivided.of(Mesh(points, faces, uv, faces), 1).moved(points.astype(np.float32), maps)

    assert found.positions[:, 2] == pytest.approx(np.where(found.positions[:, 0] < 1.5, 1.0, 2.0))


def sampled(heights: NDArray[np.float64], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    return Samples.of(uv, heights.shape, np.arange(len(uv))).read(heights)


def test_samples_go_on_beyond_the_outermost_texels() -> None:
    heights = np.array([[1.0, 2.0], [3.0, 4.0]])
    uv = np.array([[0, 1], [1, 1], [0, 0], [1, 0], [0.5, 0.5], [0.25, 0.5]], np.float64)

    assert sampled(heights, uv) == pytest.approx([1, 2, 3, 4, 2.5, 2])
    assert sampled(np.array([[7.0]]), uv) == pytest.approx([7.0] * 6)


def test_a_surface_reads_the_padding_of_a_map_without_a_padded_copy(
    small_mesh: SmallMesh, tmp_path: Path
) -> None:
    random, side = np.random.default_rng(2), 16
    padded = np.sort(random.choice(side**2, 120, replace=False)).astype(np.int32)
    padding = Padding(padded, random.integers(0, side**2, 120, np.int32))
    mesh, geometry = Mesh(*small_mesh), Geometry(Mesh(*small_mesh), "ply", 2)
    for number in range(2):  # what is known of the first frame is used for the next
        map = random.normal(0, 0.1, (side, side)).astype(np.float32)
        wanted, found, bare = (tmp_path / f"{name}{number}" for name in ("whole", "part", "bare"))
        Geometry(mesh, "ply", 2).write(wanted, mesh.positions, {1001: padding.padded(map)})
        Geometry(mesh, "ply", 2).write(bare, mesh.positions, {1001: map})
        geometry.write(found, mesh.positions, {1001: map}, {1001: padding})
        assert found.read_bytes() == wanted.read_bytes() != bare.read_bytes()


def test_a_curved_surface_is_that_of_a_sphere() -> None:
    """Within four thousandths, where flat triangles leave fifty; and it stays closed."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=1)
    uv = 0.5 + 0.1 * ball.vertices[:, :2]
    mesh = Mesh(ball.vertices.astype(np.float32), ball.faces, uv, ball.faces)
    cut = Subdivided.of(mesh, 3)
    maps = {1001: np.full((8, 8), 0.25)}
    flat, curved = (cut.moved(mesh.positions, maps, curved=c).positions for c in (False, True))
    assert np.ptp(np.linalg.norm(flat, axis=1)) > 0.05
    assert np.linalg.norm(curved, axis=1) == pytest.approx(1.25, abs=4e-3)
    assert np.array_equal(flat[: len(mesh.positions)], curved[: len(mesh.positions)])
    assert len(np.unique(curved, axis=0)) == len(np.unique(flat, axis=0))


def test_a_map_need_not_be_square() -> None:
    heights = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    uv = np.array([[0.125, 0.75], [0.875, 0.25], [0.5, 0.5]])
    assert sampled(heights, uv) == pytest.approx([1, 8, 4.5])


def test_levels_are_as_few_as_make_edges_short(small_mesh: SmallMesh) -> None:
    mesh = Mesh(*small_mesh)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    edge = float(np.quantile(np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2), 0.95))
    for share, levels in ((2.0, 0), (1.0, 0), (0.99, 1), (0.5, 1), (0.26, 2), (0.125, 3)):
        assert levels_for(mesh, share * edge) == levels
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="must be a length above 0"):
            levels_for(mesh, wrong)


def test_too_many_triangles_are_refused(small_mesh: SmallMesh) -> None:
    with pytest.raises(LimitError, match="200 triangles cut 9 times are 52428800"):
        Subdivided.of(Mesh(*small_mesh), 9)
