"""The reference of section 2.2 against what is known without it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import face_data
from meshes import SmallMesh, deform, rotate_translate, rotation
from reference.stretch import (
    calibrated_r_max,
    degenerate,
    edges,
    jacobians,
    log_stretch,
    percentile90,
    stretch,
)

seeds = st.integers(0, 2**32 - 1)
TRIANGLE = np.array([[0, 1, 2]])
PLANE = np.array([[0.0, 0.0], [1.0, 0.1], [0.2, 0.9]])


def in_space(plane, turn, shift=0.0):
    """Points of the plane, turned into space."""
    return plane @ turn[:, :2].T + shift


def along(axes, expected):
    """|cosine| between rows; the sign of an axis is free."""
    return np.abs((axes * expected / np.linalg.norm(expected, axis=-1, keepdims=True)).sum(-1))


@given(seeds, st.floats(0.3, 4.0), st.floats(0.05, 0.95))
def test_known_stretch_through_any_rotation_and_any_uv(seed, first, share):
    rng = np.random.default_rng(seed)
    second = first * share
    principal = rotation(rng, 2)
    stretched = PLANE @ (principal @ np.diag([first, second]) @ principal.T)
    to_uv = rotation(rng, 2) @ np.diag([1.0, rng.uniform(0.2, 1)]) @ rotation(rng, 2)
    to_uv = to_uv @ np.diag([1, rng.choice([-1, 1])])  # mirrored charts too
    neutral = in_space(PLANE, rotation(rng), rng.uniform(-1, 1, 3))
    deformed = in_space(stretched, rotation(rng), rng.uniform(-1, 1, 3))
    ratios, axes = stretch(neutral, TRIANGLE, PLANE @ to_uv.T, TRIANGLE, deformed)
    np.testing.assert_allclose(ratios, [[first, second]], rtol=1e-12)
    np.testing.assert_allclose(along(axes[0], (to_uv @ principal).T), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=1e-14)


@pytest.mark.parametrize("k", [0.1, 1.0, -2.5])
def test_pure_shear_keeps_area(k):
    sheared = PLANE @ np.array([[1, k], [0, 1]]).T
    ratios, axes = stretch(in_space(PLANE, np.eye(3)), TRIANGLE, PLANE, TRIANGLE, sheared @ LIFT)
    largest = (abs(k) + np.hypot(k, 2)) / 2
    np.testing.assert_allclose(ratios, [[largest, 1 / largest]], rtol=1e-13)
    np.testing.assert_allclose(along(axes[0, :1], np.array([[k, largest**2 - 1]])), 1, rtol=1e-13)


LIFT = np.eye(2, 3)


@pytest.mark.parametrize("scale", [1e-9, 0.5, 1.0, 3.0, 1e9])
def test_uniform_scale(small_mesh: SmallMesh, scale):
    ratios, _ = stretch(*small_mesh, small_mesh.positions * np.float64(scale))
    np.testing.assert_allclose(ratios, scale, rtol=1e-12)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_unit_of_length_does_not_matter(small_mesh: SmallMesh, unit):
    deformed = deform(small_mesh.positions, 3).astype(np.float64)
    expected, _ = stretch(*small_mesh, deformed)
    scaled = small_mesh._replace(positions=small_mesh.positions * np.float64(unit))
    np.testing.assert_allclose(stretch(*scaled, deformed * unit)[0], expected, rtol=1e-12)


def test_rigid_motion_is_no_stretch(small_mesh: SmallMesh):
    ratios, _ = stretch(*small_mesh, rotate_translate(small_mesh.positions, 5))
    np.testing.assert_allclose(ratios, 1, atol=5e-6)  # the motion is rounded to float32


def test_lengths_along_the_axes_change_by_the_ratios(small_mesh: SmallMesh):
    deformed = deform(small_mesh.positions, 3)
    ratios, axes = stretch(*small_mesh, deformed)
    from_uv = np.linalg.inv(edges(small_mesh.uv, small_mesh.face_uv))
    lengths = [
        np.linalg.norm(axes @ np.swapaxes(edges(p, small_mesh.faces) @ from_uv, 1, 2), axis=-1)
        for p in (small_mesh.positions, deformed)
    ]
    np.testing.assert_allclose(lengths[1] / lengths[0], ratios, rtol=1e-12)
    on_plane = axes @ np.swapaxes(jacobians(*small_mesh), 1, 2)
    np.testing.assert_allclose(np.linalg.norm(on_plane, axis=-1), lengths[0], rtol=1e-12)
    np.testing.assert_allclose((on_plane[:, 0] * on_plane[:, 1]).sum(-1), 0, atol=1e-12)


def test_degenerate_neutral_triangles_do_not_stretch():
    thin, wide = 1.9e-7, 2.1e-7  # twice the area, at a longest edge of 1
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, thin, 0], [0.5, wide, 0], [0.5, 0.8, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 0, 0], [0, 1, 1], [0, 1, 4]])
    assert degenerate(points, faces).tolist() == [True, False, True, True, False]
    assert degenerate(points[:, :2] * 1e-9, faces).tolist() == [True, False, True, True, False]
    ratios, axes = stretch(points, faces, points[:, :2], faces, points * 7)
    np.testing.assert_allclose(ratios[:, 0], [1, 7, 1, 1, 7], rtol=1e-6)
    np.testing.assert_array_equal(axes[[0, 2, 3]], np.broadcast_to(np.eye(2), (3, 2, 2)))
    flat_uv = np.zeros((5, 2))
    ratios, axes = stretch(points, faces, flat_uv, faces, points * 7)
    np.testing.assert_array_equal(ratios, 1)
    np.testing.assert_array_equal(axes, np.broadcast_to(np.eye(2), (5, 2, 2)))


def test_a_deformed_triangle_may_collapse():
    neutral = PLANE @ LIFT
    line = neutral * (2, 0, 0)
    ratios, axes = stretch(neutral, TRIANGLE, PLANE, TRIANGLE, line)
    np.testing.assert_allclose(ratios, [[2, 0]], atol=1e-15)
    np.testing.assert_allclose(np.abs(axes[0]), np.eye(2), atol=1e-15)
    ratios, axes = stretch(neutral, TRIANGLE, PLANE, TRIANGLE, neutral * 0)
    np.testing.assert_array_equal(ratios, 0)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=1e-14)


def test_log_stretch_is_clamped():
    logs = log_stretch([[100.0, 0.0], [np.e**0.25, 1.0]], 0.5)
    np.testing.assert_allclose(logs, [[0.5, -0.5], [0.25, 0.0]], rtol=1e-15)


@given(seeds, st.integers(1, 40))
def test_percentile_is_linear_and_survives_collapse(seed, triangles):
    ratios = np.exp(np.random.default_rng(seed).normal(0, 0.3, (triangles, 2)))
    expected = np.percentile(np.abs(np.log(ratios)), 90)
    assert percentile90(ratios) == pytest.approx(expected, rel=1e-13)
    assert percentile90(ratios * 0) == np.inf
    assert percentile90([1.0] * 9 + [np.e, 0.0]) == 1.0
    assert calibrated_r_max(ratios * 0, 0.5) == 0.5
    assert calibrated_r_max(ratios * 0 + 1, 0.5) == 0.01


@pytest.mark.face
def test_percentiles_of_the_real_face(face: face_data.Face):
    measured = face_data.measured_stretch()
    assert len(face.composites) == 14
    for name in face.composites:
        deformed = face.composite(name)
        ratios, _ = stretch(face.positions, face.faces, face.uv, face.face_uv, deformed)
        assert percentile90(ratios) == pytest.approx(measured[name]["log 90%"], rel=0.01), name


@pytest.mark.face
def test_a_captured_frame_stretches_as_measured(face: face_data.Face):
    deformed = face.captured(1810)
    ratios, _ = stretch(face.positions, face.faces, face.uv, face.face_uv, deformed)
    assert percentile90(ratios) == pytest.approx(0.458, rel=0.002)
