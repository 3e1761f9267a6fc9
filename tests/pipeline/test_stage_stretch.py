"""The stretch stage on small meshes: against the reference, and the laws of section 2.2."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshes import deform, rotate_translate, rotation
from pipeline.scenes import reference_stretch, sheet
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch import StretchStage, r_max_of

UV = np.array([[0.1, 0.1], [0.8, 0.2], [0.3, 0.9]])
FACES = np.array([[0, 1, 2]])
seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-9, 9).map(lambda x: 10.0**x)


def stretched(device, mesh, positions, limit=0.5):
    """(ratios, axes, clamped logs) on the host, the logs with the neutral entry at the end."""
    stage = StretchStage(device, mesh)
    found = stage.run(positions, limit)
    logs = device.read(found.logs, (len(mesh.faces) + 1, 2), np.float32)
    result = (*stage.read(found), logs)
    found.release()
    stage.release()
    return result


def triangle(rng, scale=1.0, aspect=1.0):
    """(3, 3) float32 corners, at a random place no farther away than a few edges."""
    height = aspect * rng.uniform(0.3, 1)
    flat = np.array([[0, 0, 0], [1, 0, 0], [rng.uniform(-0.5, 1.5), height, 0]])
    return ((flat @ rotation(rng).T + rng.uniform(-1, 1, 3)) * scale).astype(np.float32)


def same_axes(found, wanted, weight, bound):
    """The axes agree but for their sign, as far as the gap of the ratios (`weight`) fixes them."""
    sine = found[..., 0] * wanted[..., 1] - found[..., 1] * wanted[..., 0]
    assert (np.abs(sine).max(axis=-1) * weight).max() <= bound


def gap(ratios):
    return 1 - np.square(ratios[:, 1] / ratios[:, 0])


@pytest.mark.parametrize("seed", range(3))
def test_a_deformed_sheet_is_that_of_double(device, seed):
    mesh = sheet(seed=seed)
    positions = deform(mesh.positions, seed, 0.3)
    ratios, axes, logs = stretched(device, mesh, positions)
    wanted, directions = reference_stretch(mesh, positions)
    assert np.abs(ratios / wanted - 1).max() <= 1e-5
    same_axes(axes, directions, gap(wanted), 1e-5)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=1e-6)
    np.testing.assert_allclose(logs[:-1], np.clip(np.log(wanted), -0.5, 0.5), atol=1e-5)
    np.testing.assert_array_equal(logs[-1], 0.0)


@given(seeds, scales, st.floats(-2.5, 0))
def test_a_random_triangle_is_that_of_double(device, seed, scale, log_aspect):
    rng = np.random.default_rng(seed)
    mesh = Mesh(triangle(rng, scale, 10.0**log_aspect), FACES, UV, FACES)
    positions = triangle(rng, scale, 10.0**log_aspect)
    ratios, axes, _ = stretched(device, mesh, positions)
    wanted, directions = reference_stretch(mesh, positions)
    assert np.abs(ratios[:, 0] / wanted[:, 0] - 1).max() <= 1e-5
    # The smaller one of a sheared sliver is a difference that double itself rounds.
    noise = 1e-15 * wanted[:, 0] / wanted[:, 1]
    assert np.abs(ratios[:, 1] / wanted[:, 1] - 1).max() <= 1e-5 + noise.max()
    same_axes(axes[:, :1], directions[:, :1], gap(wanted), 1e-5)


@given(seeds, st.floats(-3, -2))
def test_a_sliver_stretched_a_little_is_that_of_double(device, seed, log_aspect):
    rng = np.random.default_rng(seed)
    corners = triangle(rng, aspect=10.0**log_aspect)
    mesh = Mesh(corners - corners[0], FACES, UV, FACES)
    positions = (mesh.positions @ (np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3)))).astype(np.float32)
    ratios = stretched(device, mesh, positions)[0]
    np.testing.assert_allclose(ratios, reference_stretch(mesh, positions)[0], rtol=1e-5)


@given(seeds, scales, st.permutations([0, 1, 2]), st.tuples(*[st.sampled_from([-1, 1])] * 3))
def test_a_turn_without_rounding_does_not_stretch(device, seed, scale, order, signs):
    mesh = Mesh(triangle(np.random.default_rng(seed), scale), FACES, UV, FACES)
    turned = mesh.positions[:, order] * np.array(signs, np.float32)
    np.testing.assert_allclose(stretched(device, mesh, turned)[0], 1.0, atol=1e-6)


@given(seeds, scales)
def test_any_rigid_motion_stretches_by_the_rounding_of_its_corners_alone(device, seed, scale):
    mesh = Mesh(triangle(np.random.default_rng(seed), scale), FACES, UV, FACES)
    turned = rotate_translate(mesh.positions / scale, seed) * np.float32(scale)
    ratios = stretched(device, mesh, turned)[0]
    np.testing.assert_allclose(ratios, reference_stretch(mesh, turned)[0], rtol=1e-6)
    # Coordinates to 4 edges, rounded by 2^-24 at both ends of edges and heights from 0.3 up.
    np.testing.assert_allclose(ratios, 1.0, atol=2 * 2 * 4 * 2.0**-24 / 0.3)


@given(seeds, scales, st.floats(0.01, 100))
def test_growing_by_s_stretches_by_s(device, seed, scale, s):
    rng = np.random.default_rng(seed)
    mesh = Mesh(triangle(rng, scale), FACES, UV, FACES)
    grown = (mesh.positions * s).astype(np.float32)
    ratios = stretched(device, mesh, grown)[0]
    np.testing.assert_allclose(ratios, s, rtol=4e-6)


@given(seeds, st.integers(-30, 30), st.integers(-30, 30))
def test_a_power_of_two_in_scale_changes_no_bit(device, seed, exponent, grown):
    rng = np.random.default_rng(seed)
    neutral, positions = triangle(rng), triangle(rng)
    plain = stretched(device, Mesh(neutral, FACES, UV, FACES), positions)
    factor = np.float32(2.0**exponent)
    scaled = stretched(device, Mesh(neutral * factor, FACES, UV, FACES), positions * factor)
    for one, other in zip(plain, scaled, strict=True):
        np.testing.assert_array_equal(one, other)
    larger = positions * np.float32(2.0**grown)
    ratios = stretched(device, Mesh(neutral, FACES, UV, FACES), larger)[0]
    np.testing.assert_array_equal(ratios, plain[0] * np.float32(2.0**grown))


FAR = 3e38


@pytest.mark.parametrize(
    "positions",
    [
        np.zeros((3, 3)),
        [[5, 5, 5]] * 3,
        [[0, 0, 0], [1, 0, 0], [1, 0, 0]],
        [[1, 0, 0], [1, 0, 0], [0, 3, 0]],
        [[0, 0, 0], [1, 1, 1], [2, 2, 2]],
        [[0, 0, 0], [1e-40, 0, 0], [0, 1e-40, 0]],
        [[0, 0, 0], [1e-45, 0, 0], [0, 0, 0]],
        [[FAR, -FAR, FAR], [-FAR, FAR, -FAR], [FAR, FAR, FAR]],
        [[FAR, 0, 0], [0, 0, 0], [0, 1e-30, 0]],
    ],
)
@pytest.mark.parametrize("size", [1.0, 1e-9, 1e9])
def test_collapsed_and_exploded_triangles_stay_finite(device, positions, size):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0]]) * size
    mesh = Mesh(corners, FACES, UV, FACES)
    ratios, axes, logs = stretched(device, mesh, np.array(positions, np.float32), limit=4.0)
    assert np.isfinite(logs).all()
    assert np.isfinite(axes).all()
    assert not np.isnan(ratios).any()
    assert (np.abs(logs) <= 4.0).all()
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=1e-6)


def test_collapsing_to_a_line_keeps_the_ratio_along_it(device):
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], FACES, UV, FACES)
    line = np.array([[0, 0, 0], [2, 0, 0], [0, 0, 0]], np.float32)
    ratios, _, logs = stretched(device, mesh, line)
    np.testing.assert_allclose(ratios, [[2, 0]], rtol=1e-6)
    np.testing.assert_array_equal(logs[0], [0.5, -0.5])


def test_a_triangle_without_area_counts_as_unstretched(device):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], np.float32)
    faces = np.array([[0, 1, 3], [0, 1, 2], [0, 1, 2], [0, 0, 1]])
    uv = np.array([*UV, [0.1, 0.1]])
    face_uv = np.array([[0, 1, 2], [0, 1, 2], [0, 1, 3], [0, 1, 2]])
    mesh = Mesh(positions, faces, uv, face_uv)
    ratios, axes, logs = stretched(device, mesh, 3 * positions)
    for flat in (0, 2, 3):
        np.testing.assert_array_equal(ratios[flat], 1.0)
        np.testing.assert_array_equal(axes[flat], np.eye(2))
        np.testing.assert_array_equal(logs[flat], 0.0)
    np.testing.assert_allclose(ratios[1], 3.0, rtol=1e-6)


def test_the_neutral_frame_is_exactly_unstretched(device):
    ratios, axes, logs = stretched(device, sheet(), None)
    np.testing.assert_array_equal(ratios, 1.0)
    np.testing.assert_array_equal(axes, np.broadcast_to(np.eye(2), axes.shape))
    np.testing.assert_array_equal(logs, 0.0)


def test_positions_equal_to_the_neutral_stretch_by_one(device):
    mesh = sheet()
    ratios = stretched(device, mesh, mesh.positions)[0]
    np.testing.assert_allclose(ratios, 1.0, atol=1e-6)


def test_r_max_is_the_percentile_kept_in_its_range():
    logs = np.linspace(0, 0.4, 11)[:, None] * [1, 1]
    ratios = np.exp(np.where(np.arange(11)[:, None] % 2, logs, -logs)).astype(np.float32)
    assert r_max_of(ratios, 0.5) == pytest.approx(np.percentile(logs, 90), rel=1e-6)
    assert r_max_of(ratios, 0.1) == 0.1
    assert r_max_of(np.ones((9, 2), np.float32), 0.5) == 0.01
    assert r_max_of(np.zeros((9, 2), np.float32), 0.5) == 0.5
