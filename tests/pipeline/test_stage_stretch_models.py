"""Stretch by mesh tension and along u and v: against the reference, and by laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import deform, rotate_translate, rotation
from pipeline.scenes import Scene, random_graph, reference_stretch, settings_of, sheet
from reference import drawing
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch import StretchStage, edges_by_vertex

MODELS = ("tension", "uv")
both = pytest.mark.parametrize("model", MODELS)
few = settings(max_examples=25)  # each uploads a mesh of its own
seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-9, 9).map(lambda x: 10.0**x)
UV = np.array([[0.1, 0.1], [0.8, 0.2], [0.3, 0.9], [0.9, 0.9]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0], [1.1, 0.9, 0.2]])
FAR = 3e38


def stretched(device, mesh, positions, model, limit=0.5):
    """(ratios, axes, clamped logs), the logs with the neutral entry at the end."""
    stage = StretchStage(device, mesh)
    found = stage.run(positions, limit, model)
    logs = device.read(found.logs, (len(mesh.faces) + 1, 2), np.float32)
    result = (*stage.read(found), logs)
    found.release()
    stage.release()
    return result


def quad(seed, scale=1.0, aspect=1.0):
    """Two triangles in space, one of which shrinks to a sliver with `aspect`."""
    rng = np.random.default_rng(seed)
    corners = CORNERS + rng.uniform(-0.1, 0.1, (4, 3))
    corners[2] = corners[0] + (corners[1] - corners[0]) * 0.4 + (corners[2] - corners[0]) * aspect
    return Mesh(corners @ rotation(rng).T * scale, FACES, UV, FACES)


@both
@pytest.mark.parametrize("seed", range(3))
def test_a_deformed_sheet_is_that_of_double(device, seed, model):
    mesh = sheet(seed=seed)
    positions = deform(mesh.positions, seed, 0.3)
    ratios, axes, logs = stretched(device, mesh, positions, model)
    wanted, directions = reference_stretch(mesh, positions, model)
    np.testing.assert_allclose(ratios, wanted, rtol=1e-6)
    np.testing.assert_array_equal(axes, directions)
    np.testing.assert_allclose(logs[:-1], np.clip(np.log(wanted), -0.5, 0.5), atol=1e-6)
    np.testing.assert_array_equal(logs[-1], 0.0)
    assert np.ptp(np.log(wanted)) > 0.2


@both
@few
@given(seeds, scales, st.floats(-3, 0))
def test_slivers_of_any_size_are_those_of_double(device, model, seed, scale, log_aspect):
    mesh = quad(seed, scale, 10.0**log_aspect)
    positions = quad(seed + 1, scale, 10.0**log_aspect).positions
    ratios = stretched(device, mesh, positions, model)[0]
    np.testing.assert_allclose(ratios, reference_stretch(mesh, positions, model)[0], rtol=2e-6)


@both
@few
@given(seeds, scales)
def test_a_rigid_motion_stretches_by_the_rounding_of_its_corners_alone(device, model, seed, scale):
    mesh = quad(seed, scale)
    turned = rotate_translate(mesh.positions / np.float32(scale), seed) * np.float32(scale)
    ratios = stretched(device, mesh, turned, model)[0]
    np.testing.assert_allclose(ratios, reference_stretch(mesh, turned, model)[0], rtol=1e-6)
    # Coordinates to 4 edges, rounded by 2^-24 at both ends of edges and heights from 0.3 up.
    np.testing.assert_allclose(ratios, 1.0, atol=2 * 2 * 4 * 2.0**-24 / 0.3)


@both
@few
@given(seeds, scales, st.floats(0.01, 100))
def test_growing_by_s_stretches_by_s(device, model, seed, scale, s):
    mesh = quad(seed, scale)
    ratios = stretched(device, mesh, (mesh.positions * s).astype(np.float32), model)[0]
    np.testing.assert_allclose(ratios, s, rtol=4e-6)


@both
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_the_unit_of_length_does_not_matter(device, model, scale):
    mesh = sheet()
    positions = deform(mesh.positions, 4, 0.3)
    tiny = Mesh(mesh.positions * scale, mesh.faces, mesh.uv, mesh.face_uv)
    ratios = stretched(device, tiny, positions * np.float32(scale), model)[0]
    np.testing.assert_allclose(ratios, stretched(device, mesh, positions, model)[0], rtol=4e-6)


@both
def test_the_neutral_frame_is_exactly_unstretched(device, model):
    ratios, _, logs = stretched(device, sheet(), None, model)
    np.testing.assert_array_equal(ratios, 1.0)
    np.testing.assert_array_equal(logs, 0.0)
    np.testing.assert_allclose(
        stretched(device, sheet(), sheet().positions, model)[0], 1.0, atol=1e-6
    )


@both
@pytest.mark.parametrize("size", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize(
    "positions",
    [
        np.zeros((4, 3)),
        [[5, 5, 5]] * 4,
        [[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]],
        [[0, 0, 0], [1e-40, 0, 0], [0, 1e-40, 0], [1e-45, 0, 0]],
        [[FAR, -FAR, FAR], [-FAR, FAR, -FAR], [FAR, FAR, FAR], [0, 0, 0]],
        [[FAR, 0, 0], [0, 0, 0], [0, 1e-30, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, 0, 0], [FAR, FAR, FAR]],
    ],
)
def test_collapsed_and_exploded_triangles_stay_finite(device, model, positions, size):
    mesh = Mesh(CORNERS * size, FACES, UV, FACES)
    ratios, axes, logs = stretched(device, mesh, np.array(positions, np.float32), model, 4.0)
    assert np.isfinite(logs).all()
    assert (np.abs(logs) <= 4.0).all()
    assert not np.isnan(ratios).any()
    np.testing.assert_array_equal(axes, np.broadcast_to(np.eye(2), axes.shape))


@both
def test_a_collapse_is_the_clamp_and_so_is_an_explosion(device, model):
    mesh = Mesh(CORNERS, FACES, UV, FACES)
    for positions, r in ((np.zeros((4, 3), np.float32), -0.5), (mesh.positions * 1e30, 0.5)):
        logs = stretched(device, mesh, positions.astype(np.float32), model)[2]
        np.testing.assert_array_equal(logs[:-1], np.float32(r))
        np.testing.assert_array_equal(logs[-1], 0.0)


def test_a_pure_shear_stretches_v_alone(device):
    """u runs along x and v along y: (x + k y, y) leaves u as it is and tilts v."""
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], QUADS, SQUARE_UV, QUADS)
    for k in (0.25, 1.0, -2.0):
        sheared = square.positions + square.positions[:, 1:2] * np.float32([k, 0, 0])
        ratios = stretched(device, square, sheared, "uv")[0]
        np.testing.assert_allclose(ratios, [[1, np.hypot(1, k)]] * 2, rtol=1e-6)
        # The tensor finds axes of its own: it stretches along one and shrinks along the other.
        principal = stretched(device, square, sheared, "tensor")[0]
        np.testing.assert_allclose(principal.prod(axis=1), 1, rtol=1e-5)
        assert (principal[:, 1] < 0.95).all()


QUADS = np.array([[0, 1, 2], [0, 2, 3]])
SQUARE_UV = np.array([[0.2, 0.2], [0.7, 0.2], [0.7, 0.7], [0.2, 0.7]])


def test_stretch_along_u_and_v_is_told_apart_in_turned_and_mirrored_charts(device):
    for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, 1]]):
        uv = (SQUARE_UV - 0.45) @ np.array(turn).T + 0.5
        square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], QUADS, uv, QUADS)
        ratios = stretched(device, square, square.positions * np.float32([3, 0.5, 1]), "uv")[0]
        wanted = [0.5, 3] if turn[0][0] == 0 else [3, 0.5]
        np.testing.assert_allclose(ratios, [wanted] * 2, rtol=1e-6)


def test_triangles_without_area_do_not_stretch_along_u_and_v(device):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], np.float32)
    faces = np.array([[0, 1, 3], [0, 1, 2], [0, 1, 2], [0, 0, 1]])
    face_uv = np.array([[0, 1, 2], [0, 1, 2], [0, 1, 1], [0, 1, 2]])
    mesh = Mesh(positions, faces, UV, face_uv)
    ratios, _, logs = stretched(device, mesh, 3 * positions, "uv")
    np.testing.assert_array_equal(ratios[[0, 2, 3]], 1.0)
    np.testing.assert_array_equal(logs[[0, 2, 3]], 0.0)
    np.testing.assert_allclose(ratios[1], 3.0, rtol=1e-6)
    # Edges have a tension in any triangle, as long as they have a length.
    np.testing.assert_allclose(stretched(device, mesh, 3 * positions, "tension")[0], 3, rtol=1e-6)


def test_isolated_vertices_and_edges_without_length_do_not_count(device):
    positions = np.vstack([CORNERS, CORNERS[:1], [[9, 9, 9]]])
    faces = np.vstack([FACES, [[0, 4, 4]]])  # 4 lies on 0, 5 is in no triangle
    mesh = Mesh(positions, faces, UV, np.vstack([FACES, [[0, 1, 2]]]))
    offsets, _, rest = edges_by_vertex(mesh)
    assert np.diff(offsets).tolist() == [2, 3, 3, 2, 0, 0]
    assert np.isfinite(rest).all()
    ratios = stretched(device, mesh, 2 * mesh.positions, "tension")[0]
    # Vertex 4 has no edge left and counts as unstretched: 2, 1, 1 have the mean log of log(2)/3.
    np.testing.assert_allclose(ratios[:, 0], [2, 2, 2 ** (1 / 3)], rtol=1e-6)
    np.testing.assert_allclose(
        ratios, reference_stretch(mesh, 2 * mesh.positions, "tension")[0], rtol=1e-6
    )


def test_an_edge_too_short_for_a_float32_does_not_count():
    positions = np.vstack([CORNERS, CORNERS[:1] + np.array([1e-41, 0, 0])]).astype(np.float32)
    faces = np.vstack([FACES, [[0, 4, 1]]])
    mesh = Mesh(positions, faces, UV, np.vstack([FACES, [[0, 1, 2]]]))
    offsets, neighbours, rest = edges_by_vertex(mesh)
    assert positions[4, 0] > 0
    assert neighbours[offsets[4] : offsets[5]].tolist() == [1]
    assert np.isfinite(rest).all()


def test_an_edge_of_many_triangles_counts_once(device):
    """Three wings on one edge, one of them twice: each vertex on the edge has four edges."""
    positions = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], np.float32)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [0, 1, 4]])
    mesh = Mesh(positions, faces, UV, np.tile([0, 1, 2], (4, 1)))
    assert np.diff(edges_by_vertex(mesh)[0]).tolist() == [4, 4, 2, 2, 2]
    taller = positions * np.float32([1, 1, 5])
    ratios = stretched(device, mesh, taller, "tension")[0]
    slope = np.sqrt(26 / 2)
    at_edge, low, high = (5 + 3) / 4, (5 + 3 * slope) / 4, (1 + slope) / 2
    wanted = (at_edge * low * high) ** (1 / 3)
    np.testing.assert_allclose(ratios, wanted, rtol=1e-6)
    np.testing.assert_allclose(ratios, reference_stretch(mesh, taller, "tension")[0], rtol=1e-6)


@both
def test_a_map_redrawn_by_a_model_is_that_of_double(device, model):
    scene = Scene(device, sheet(), random_graph(1), settings_of())
    positions = deform(scene.mesh.positions, 11, 0.15)
    found = scene.redrawn(positions, at=(64, 64), side=128, model=model)
    wanted = scene.expected(drawing.crop(64, 64, 128, 128, 256), positions, model=model)
    assert np.abs(found - wanted.reshape(128, 128)).max() <= 1e-4 * 0.03
    assert np.abs(found - scene.redrawn(positions, at=(64, 64), side=128)).max() > 0.1 * 0.03
