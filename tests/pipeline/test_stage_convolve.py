"""The convolved neutral map against the reference, and the laws that it keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform, rotate_translate
from pipeline.convolving import BOUND, LARGE, SMALL, R, Stage, noise, square
from pipeline.scenes import sheet
from reference import convolve, stretch
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.convolve import neutral_jacobians


@pytest.mark.parametrize("model", ["tensor", "tension", "uv"])
@pytest.mark.parametrize("sigma", [SMALL, LARGE])
def test_the_map_is_that_of_double(device, model, sigma):
    stage = Stage(device, sheet(), noise(), sigma)
    found = stage.stretch(deform(stage.mesh.positions, 3, 0.15), model)
    convolved = stage.convolved(found)
    assert np.abs(convolved - stage.heights).max() > 0.1
    assert np.abs(convolved - stage.expected(found)).max() <= BOUND


def test_blur_and_sharpening_have_gains_of_their_own(device):
    for gains in ((0.0, 3.0), (5.0, 0.0), (2.0, 7.0)):
        blur, sharpen = gains
        stage = Stage(device, sheet(), noise(), blur_gain=blur, sharpen_gain=sharpen)
        found = stage.stretch(deform(stage.mesh.positions, 3, 0.15))
        assert np.abs(stage.convolved(found) - stage.expected(found)).max() <= BOUND


@pytest.mark.parametrize("mesh", [sheet(), square()], ids=["charts", "up to the border"])
@pytest.mark.parametrize("sigma", [SMALL, LARGE])
def test_a_tile_is_the_crop_of_the_map_bit_for_bit(device, mesh, sigma):
    stage = Stage(device, mesh, noise(), sigma)
    found = stage.stretch(deform(mesh.positions, 4, 0.15))
    whole = stage.convolved(found)
    for side in (64, 128):
        for row in range(0, R, side):
            for column in range(0, R, side):
                tile = stage.convolved(found, row, column, side)
                crop = whole[row : row + side, column : column + side]
                np.testing.assert_array_equal(tile, crop)


def test_the_apron_changes_no_bit(device, monkeypatch):
    stage = Stage(device, sheet(), noise())
    found = stage.stretch(deform(stage.mesh.positions, 4, 0.15))
    aprons = {stage.convolve.apron(stage.settings, 1001, 64, 64, 64), 64}
    assert len(aprons) == 2
    tiles = []
    for apron in aprons:
        monkeypatch.setattr(stage.convolve, "apron", lambda *_, apron=apron: apron)
        tiles.append(stage.convolved(found, 64, 64, 64))
    np.testing.assert_array_equal(*tiles)


def test_a_level_is_the_mean_of_the_one_below(device):
    stage = Stage(device, sheet(), noise())
    found = stage.stretch(deform(stage.mesh.positions, 4, 0.15))
    fine = stage.convolved(found)
    a, b, c, d = (fine[y::2, x::2] for y in (0, 1) for x in (0, 1))
    coarse = stage.convolved(found, 0, 0, R // 2, level=1)
    np.testing.assert_array_equal(coarse, np.float32(0.25) * ((a + b) + (c + d)))


def test_the_neutral_frame_is_the_neutral_map_bit_for_bit(device):
    stage = Stage(device, sheet(), noise())
    for model in ("tensor", "tension", "uv"):
        np.testing.assert_array_equal(stage.frame(None, model), stage.heights)


def test_a_rigid_motion_is_the_neutral_up_to_the_rounding_of_positions(device):
    stage = Stage(device, sheet(), noise())
    found = stage.stretch(rotate_translate(stage.mesh.positions, 5))
    logs = device.read(found.logs, (found.count, 2), np.float32)
    # alpha <= 4 |r|; a pass changes a height by alpha times the range of the heights at most.
    change = 2 * 4 * np.abs(logs).max() * 2
    assert 0 < np.abs(stage.convolved(found) - stage.heights).max() <= change < 1e-4


def test_signs_of_axes_change_no_bit(device):
    stage = Stage(device, sheet(), noise())
    found = stage.stretch(deform(stage.mesh.positions, 6, 0.15))
    axes = device.read(found.axes, (found.count, 4), np.float32)
    plain = stage.convolved(found)
    for signs in ([-1, -1, 1, 1], [1, 1, -1, -1], [-1, -1, -1, -1]):
        turned = replace(found, axes=device.upload(axes * np.float32(signs)))
        np.testing.assert_array_equal(stage.convolved(turned), plain)


@pytest.mark.parametrize(("stretched", "waves"), [(0, 1), (1, 0)], ids=["along u", "along v"])
@pytest.mark.parametrize("ratio", [0.8, 1.2])
def test_a_wave_across_the_stretch_changes_as_the_transform_says(device, stretched, waves, ratio):
    sigma, frequency = 3.0, 1 / 16
    wave = np.cos(2 * np.pi * frequency * (np.arange(R) + 0.5))
    across = np.broadcast_to(wave if stretched == 0 else wave[:, None], (R, R))
    stage = Stage(device, square(), across, sigma / R)
    positions = stage.mesh.positions.copy()
    positions[:, stretched] *= np.float32(ratio)
    found = stage.frame(positions)
    alpha = float(np.clip(4.0 * np.log(ratio), -1, 1))
    relief = convolve.gain(alpha, sigma, frequency)
    assert (relief < 0.8) if ratio > 1 else (relief > 1.2)
    inside = (slice(16, -16), slice(16, -16))  # the border repeats its texel
    np.testing.assert_allclose(found[inside], relief * across[inside], atol=1e-5)
    # What runs along the stretch stays: the method blurs by axis, not by feature, but a feature
    # that is the same all along the axis has nothing to lose.
    along = Stage(device, square(), across.T, sigma / R)
    np.testing.assert_allclose(along.frame(positions), across.T, atol=1e-5)


def test_a_flat_map_stays_flat(device):
    stage = Stage(device, sheet(), np.full((R, R), 0.7), LARGE)
    found = stage.frame(deform(stage.mesh.positions, 7, 0.2))
    np.testing.assert_allclose(found, 0.7, rtol=2e-6)


def test_isotropic_stretch_takes_relief_from_everything(device):
    stage = Stage(device, square(), noise(), 3.0 / R)
    for ratio, grows in ((1.1, False), (0.9, True)):
        found = stage.frame(stage.mesh.positions * np.float32(ratio))
        assert (np.std(found) > np.std(stage.heights)) == grows


def test_collapsed_and_exploded_frames_give_finite_maps(device):
    for mesh in (sheet(), square()):
        stage = Stage(device, mesh, noise(), LARGE)
        rng = np.random.default_rng(8)
        exploded = rng.normal(size=mesh.positions.shape) * 1e9
        for positions in (0 * mesh.positions, exploded, mesh.positions * [1, 0, 0]):
            for model in ("tensor", "tension", "uv"):
                found = stage.frame(positions.astype(np.float32), model)
                assert np.isfinite(found).all()
                assert np.abs(found).max() <= 9


def test_texels_in_no_triangle_and_triangles_without_area_are_left(device):
    faces = np.array([[0, 1, 2], [0, 0, 2]])  # the second is a line in space, not in UV
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    uv = np.array([[0.1, 0.1], [0.5, 0.1], [0.1, 0.5], [0.9, 0.9], [0.5, 0.9], [0.9, 0.5]])
    mesh = Mesh(positions, faces, uv, np.array([[0, 1, 2], [3, 4, 5]]))
    stage = Stage(device, mesh, noise())
    for model in ("tensor", "tension", "uv"):
        found = stage.frame(1.5 * mesh.positions, model)
        triangles = device.read(stage.located.texels(R, 0, 0, R), (R, R), np.int32)
        left = triangles > 0
        assert set(np.unique(triangles)) == {0, 1, 2}
        np.testing.assert_array_equal(found[left], stage.heights[left])
        assert (found[~left] != stage.heights[~left]).mean() > 0.99


def test_a_larger_mesh_is_the_same_picture(device):
    positions = deform(sheet().positions, 9, 0.15)
    maps = []
    for factor in (1.0, 2.0**-30, 2.0**30):
        mesh = sheet()
        body = Mesh(mesh.positions * np.float32(factor), mesh.faces, mesh.uv, mesh.face_uv)
        stage = Stage(device, body, noise(), SMALL * factor)
        maps.append(stage.frame(positions * np.float32(factor)))
    np.testing.assert_array_equal(maps[1], maps[0])
    np.testing.assert_array_equal(maps[2], maps[0])


def test_nothing_is_left_on_the_device(device):
    stage = Stage(device, sheet(), noise())
    found = stage.stretch(deform(stage.mesh.positions, 4, 0.15))
    used = device.budget.used
    stage.convolved(found)
    assert device.budget.used == used


def test_jacobians_are_those_of_the_reference_up_to_a_turn():
    mesh = sheet()
    ours = neutral_jacobians(mesh)[:-1].reshape(-1, 2, 2).astype(np.float64)
    theirs = stretch.jacobians(mesh.positions, mesh.faces, mesh.uv, mesh.face_uv)
    squares = [np.swapaxes(j, 1, 2) @ j for j in (ours, theirs)]
    np.testing.assert_allclose(*squares, rtol=1e-5, atol=1e-5 * np.abs(squares[0]).max())
