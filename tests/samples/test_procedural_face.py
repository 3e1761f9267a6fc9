from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import FrameError, MeshError
from rhytid_lab.samples.face import SampleFace, procedural_face

EXPRESSIONS = (
    "brow_furrow",
    "brow_raise",
    "cheek_puff",
    "frown",
    "jaw_open",
    "pucker",
    "smile",
    "squint",
)


@pytest.fixture(scope="module")
def face() -> SampleFace:
    return procedural_face()


def plane_edges(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 2, 2) two edges of each triangle, as columns, in an orthonormal frame of its plane."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(first, axis=1)
    edges = np.zeros((len(corners), 2, 2))
    edges[:, 0, 0] = length
    edges[:, 0, 1] = np.sum(first * second, axis=1) / length
    edges[:, 1, 1] = np.linalg.norm(np.cross(first, second), axis=1) / length
    return edges


def log_stretch(mesh: Mesh, positions: NDArray[np.float32]) -> NDArray[np.float64]:
    """(F, 2) logarithms of the singular values, the greater first."""
    neutral = plane_edges(mesh.positions[mesh.faces].astype(np.float64))
    deformed = plane_edges(positions[mesh.faces].astype(np.float64))
    return np.log(np.linalg.svd(deformed @ np.linalg.inv(neutral), compute_uv=False))


def mean_near(mesh: Mesh, values: NDArray[np.float64], x: float, y: float) -> float:
    """Mean of per-triangle values within 5 mm of a point of the front view."""
    centre = mesh.positions[mesh.faces].mean(axis=1)
    near = (np.hypot(np.abs(centre[:, 0]) - x, centre[:, 1] - y) < 0.5) & (centre[:, 2] > -4)
    return float(values[near].mean())


def boundary_loops(mesh: Mesh) -> list[int]:
    """Lengths of the closed chains of edges that have one triangle."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    present = {(int(a), int(b)) for a, b in edges}
    following = {a: b for a, b in present if (b, a) not in present}
    loops = []
    while following:
        start, here = following.popitem()
        length = 1
        while here != start:
            here = following.pop(here)
            length += 1
        loops.append(length)
    return sorted(loops)


def uv_area(mesh: Mesh) -> NDArray[np.float64]:
    corners = mesh.triangle_uv()
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    return np.linalg.det(edges) / 2


def test_face_is_human_sized_and_looks_forward(face: SampleFace) -> None:
    positions, faces = face.mesh.positions, face.mesh.faces
    low, high = positions.min(axis=0), positions.max(axis=0)
    assert 17 < high[0] - low[0] < 19
    assert 22.5 < high[1] - low[1] < 25
    assert 8_000 <= len(faces) <= 20_000
    a, b, c = (positions[faces[:, i]].astype(np.float64) for i in range(3))
    assert np.mean(np.cross(b - a, c - a)[:, 2] > 0) > 0.9
    tip = positions[np.argmax(positions[:, 2])]
    assert abs(tip[0]) < 1e-6


def test_every_triangle_has_area_in_space_and_uv(face: SampleFace) -> None:
    assert face.mesh.usable_triangles().all()


@pytest.mark.parametrize("resolution", [16, 40, 96])
def test_surface_is_a_disc_with_a_slit_for_the_mouth(resolution: int) -> None:
    mesh = procedural_face(resolution).mesh
    mouth, outline = boundary_loops(mesh)
    assert outline == 4 * resolution
    assert mouth < outline / 3
    assert len(mesh.faces) == 2 * resolution**2


@pytest.mark.parametrize("resolution", [16, 40, 96])
def test_uv_is_one_unflipped_chart_inside_the_margin(resolution: int) -> None:
    mesh = procedural_face(resolution).mesh
    assert mesh_udims(mesh) == (1001,)
    assert mesh.uv.min() >= 0.02
    assert mesh.uv.max() <= 0.98
    assert (uv_area(mesh) > 0).all()


def test_uv_does_not_overlap(face: SampleFace) -> None:
    corners = face.mesh.triangle_uv()
    following = np.roll(corners, -1, axis=1) - corners
    points = np.random.default_rng(5).uniform(0.02, 0.98, (1000, 2))
    holders = np.empty(len(points), np.int64)
    for i, point in enumerate(points):
        to_point = point - corners
        left = following[..., 0] * to_point[..., 1] - following[..., 1] * to_point[..., 0]
        holders[i] = np.count_nonzero((left > 0).all(axis=1))
    assert holders.max() == 1
    assert np.mean(holders) > 0.6


def test_uv_is_nearly_isometric(face: SampleFace) -> None:
    mesh = face.mesh
    corners = mesh.triangle_uv()
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    space = plane_edges(mesh.positions[mesh.faces].astype(np.float64))
    values = np.linalg.svd(edges @ np.linalg.inv(space), compute_uv=False)
    scale = np.sqrt(values[:, 0] * values[:, 1])
    assert np.percentile(values[:, 0] / values[:, 1], 50) < 1.15
    assert np.percentile(values[:, 0] / values[:, 1], 99) < 1.6
    assert np.percentile(scale, 99) / np.percentile(scale, 1) < 1.6


def mirror(mesh: Mesh) -> NDArray[np.int64]:
    """(V,) index of the vertex with mirrored position and uv."""
    key = np.concatenate([mesh.positions, 20 * mesh.uv], axis=1)
    mirrored = np.concatenate(
        [mesh.positions * (-1, 1, 1), 20 * (mesh.uv * (-1, 1) + (1, 0))], axis=1
    )
    order = np.lexsort(np.round(key, 4).T)
    other = np.lexsort(np.round(mirrored, 4).T)
    partner = np.empty(len(key), np.int64)
    partner[other] = order
    return partner


def test_face_and_expressions_are_symmetric(face: SampleFace) -> None:
    partner = mirror(face.mesh)
    flip = np.array([-1, 1, 1], np.float32)
    np.testing.assert_allclose(
        face.mesh.positions[partner], face.mesh.positions * flip, atol=1e-5, rtol=0
    )
    np.testing.assert_allclose(
        face.mesh.uv[partner], face.mesh.uv * (-1, 1) + (1, 0), atol=1e-9, rtol=0
    )
    for offsets in face.expressions.values():
        np.testing.assert_allclose(offsets[partner], offsets * flip, atol=1e-5, rtol=0)


def test_the_expressions_are_these(face: SampleFace) -> None:
    assert tuple(sorted(face.expressions)) == EXPRESSIONS
    for offsets in face.expressions.values():
        assert offsets.dtype == np.float32
        assert offsets.shape == face.mesh.positions.shape


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expressions_stretch_like_skin(face: SampleFace, name: str) -> None:
    logs = log_stretch(face.mesh, face.pose({name: 1.0}))
    assert 0.09 < np.percentile(np.abs(logs), 90) < 0.35
    assert -1 < np.percentile(logs, 1) < np.percentile(logs, 99) < 1
    assert np.abs(logs).max() < 1.2


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expressions_are_smooth(face: SampleFace, name: str) -> None:
    # Neighbouring triangles are about 2 mm apart: their stretch may differ by a few per cent.
    mesh = face.mesh
    logs = log_stretch(mesh, face.pose({name: 1.0}))
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]),
        axis=1,
    )
    triangle = np.tile(np.arange(len(mesh.faces)), 3)
    order = np.lexsort(edges.T)
    shared = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    pairs = np.stack([triangle[order][1:], triangle[order][:-1]])[:, shared]
    step = np.abs(logs[pairs[0]] - logs[pairs[1]])
    assert np.percentile(step, 99) < 0.13


def test_smile_moves_the_corners_out_up_and_back(face: SampleFace) -> None:
    mesh, offsets = face.mesh, face.expressions["smile"]
    corner = np.argmin(np.linalg.norm(mesh.positions[:, :2] - (2.64, -6.6), axis=1))
    out, up, forward = offsets[corner]
    assert out > 0.5
    assert up > 0.5
    assert forward < -0.2


def test_smile_stretches_the_lips_and_compresses_the_fold_and_the_lower_lid(
    face: SampleFace,
) -> None:
    logs = log_stretch(face.mesh, face.pose({"smile": 1.0}))
    assert mean_near(face.mesh, logs[:, 0], 0.8, -7.3) > 0.2
    assert mean_near(face.mesh, logs[:, 1], 3.5, -5.8) < -0.25
    assert mean_near(face.mesh, logs[:, 1], 3.6, -0.4) < -0.1


def test_jaw_open_turns_the_chin_down_and_back_and_parts_the_lips(face: SampleFace) -> None:
    mesh, offsets = face.mesh, face.expressions["jaw_open"]
    chin = np.argmin(np.linalg.norm(mesh.positions[:, :2] - (0, -10.5), axis=1))
    assert offsets[chin, 1] < -1.5
    assert offsets[chin, 2] < -0.3
    opened = face.pose({"jaw_open": 1.0})
    lips = np.linalg.norm(mesh.positions[:, None, :2] - (0, -6.6), axis=2)[:, 0] < 0.05
    assert np.ptp(mesh.positions[lips, 1]) < 1e-6
    assert np.ptp(opened[lips, 1]) > 1.5
    logs = log_stretch(mesh, opened)
    assert mean_near(mesh, logs[:, 0], 5.0, -6.5) > 0.15


def test_brow_raise_compresses_the_forehead_along_y(face: SampleFace) -> None:
    logs = log_stretch(face.mesh, face.pose({"brow_raise": 1.0}))
    assert mean_near(face.mesh, logs[:, 1], 1.5, 6.2) < -0.2
    assert abs(mean_near(face.mesh, logs[:, 0], 1.5, 6.2)) < 0.05


def test_pose_is_linear_and_names_what_it_does_not_know(face: SampleFace) -> None:
    both = face.pose({"smile": 0.5, "jaw_open": 0.25})
    sums = 0.5 * face.expressions["smile"] + 0.25 * face.expressions["jaw_open"]
    np.testing.assert_allclose(both - face.mesh.positions, sums, atol=5e-6)
    with pytest.raises(FrameError, match="'grin': one of brow_furrow"):
        face.pose({"grin": 1.0})


def test_animation_eases_from_neutral_to_each_key_and_back(face: SampleFace) -> None:
    frames = face.animation(["smile", {"jaw_open": 0.5}], 33)
    neutral = face.mesh.positions
    assert frames.shape == (33, len(neutral), 3)
    assert frames.dtype == np.float32
    for quiet in (0, 16, 32):
        np.testing.assert_array_equal(frames[quiet], neutral)
    np.testing.assert_array_equal(frames[8], face.pose({"smile": 1.0}))
    np.testing.assert_array_equal(frames[24], face.pose({"jaw_open": 0.5}))
    moved = np.abs(frames - neutral).max(axis=(1, 2))
    assert (np.diff(moved[:9]) > 0).all()
    assert moved[1] < 0.1 * moved[8]


@pytest.mark.parametrize(("keys", "frames"), [([], 10), (["smile", "frown"], 3)])
def test_animation_refuses_too_little(face: SampleFace, keys: list[str], frames: int) -> None:
    with pytest.raises(FrameError, match="two frames each"):
        face.animation(keys, frames)


@pytest.mark.parametrize("resolution", [15, 14, 514])
def test_resolution_out_of_range(resolution: int) -> None:
    with pytest.raises(MeshError, match=f"resolution {resolution}"):
        procedural_face(resolution)
