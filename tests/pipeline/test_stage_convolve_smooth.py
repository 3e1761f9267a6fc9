"""The neutral map convolved by the stretch of each texel, against the reference, and its laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import bumpy_grid, deform, rotate_translate
from pairs import pairs
from pipeline.convolving import BOUND, LARGE, SMALL, R, SmoothStage, Stage, noise, square
from pipeline.scenes import sheet
from pipeline.smooth_scenes import mesh_of, reference_fields
from reference import convolve
from reference import smooth as reference
from rhytid.domain.mesh import Mesh

pytestmark = pytest.mark.release

MODELS = pytest.mark.parametrize("model", ["tensor", "tension", "uv"])


def bent(mesh, seed=3):
    return deform(mesh.positions, seed, 0.15)


@pytest.mark.parametrize(
    ("sigma", "model"),
    [
        (SMALL, "tensor"),
        *(pytest.param(SMALL, model, marks=pytest.mark.slow) for model in ("tension", "uv")),
        *(pytest.param(3 * SMALL, m, marks=pytest.mark.slow) for m in ("tensor", "tension", "uv")),
    ],
)
def test_a_tile_is_that_of_double(device, model, sigma):
    stage = SmoothStage(device, sheet(), noise(), sigma)
    positions = bent(stage.mesh)
    place = (96, 128, 48)
    found = stage.frame(positions, model, row=96, column=128, side=48)
    wanted, sure = stage.expected(positions, model, *place)
    assert np.abs(wanted - stage.heights[96:144, 128:176]).max() > 0.1
    assert sure.mean() > 0.5
    assert np.abs(found - wanted)[sure].max() <= BOUND


@pytest.mark.parametrize(
    ("make", "sigma", "model"),
    pairs([sheet, square], [SMALL, LARGE], ["tensor", "tension", "uv"]),
)
def test_a_tile_is_the_crop_of_the_map_bit_for_bit(device, make, sigma, model):
    """The sheet has charts with gaps between, the square goes up to the border."""
    mesh = make()
    stage = SmoothStage(device, mesh, noise(), sigma)
    found = stage.stretch(bent(mesh), model)
    whole = stage.convolved(found)
    assert np.abs(whole - stage.heights).max() > 0.1
    for side, row, column in (
        *((64, row, column) for row, column in [(0, 0), (0, 192), (192, 64), (64, 128)]),
        *((128, row, column) for row, column in [(0, 128), (128, 0), (64, 64)]),
    ):
        tile = stage.convolved(found, row, column, side)
        crop = whole[row : row + side, column : column + side]
        np.testing.assert_array_equal(tile, crop)


@pytest.mark.parametrize("thin", [1.0, 1e-3], ids=["plain", "squeezed"])
def test_the_apron_changes_no_bit(device, monkeypatch, thin):
    mesh = sheet()
    body = Mesh(mesh.positions * np.float32([1, thin, 1]), mesh.faces, mesh.uv, mesh.face_uv)
    stage = SmoothStage(device, body, noise())
    found = stage.stretch(bent(body) * np.float32([1, thin, 1]))
    aprons = {stage.convolve.apron(stage.settings, 1001, 64, 64, 64), 64}
    assert len(aprons) == (2 if thin == 1.0 else 1)
    tiles = []
    for apron in (*aprons, 80):
        monkeypatch.setattr(stage.convolve, "apron", lambda *_, apron=apron: apron)
        tiles.append(stage.convolved(found, 64, 64, 64))
    for tile in tiles[1:]:
        np.testing.assert_array_equal(tile, tiles[0])


@pytest.mark.parametrize("thin", [1.0, 0.05])
def test_no_texel_is_slower_than_its_triangle_says(device, thin):
    mesh = sheet()
    body = Mesh(mesh.positions * np.float32([1, thin, 1]), mesh.faces, mesh.uv, mesh.face_uv)
    metrics, _ = reference_fields(body, body.positions, "tensor")
    owner = reference.corners(*mesh_of(body)[1:])[1]
    shares = np.random.default_rng(2).dirichlet(np.full(3, 0.5), (len(mesh.faces), 50))
    inside = np.einsum("fpk,fkij->fpij", shares, metrics[owner])
    least = np.sqrt(np.linalg.eigvalsh(inside)[..., 0].min(axis=1))
    bound = SmoothStage(device, body, noise()).smooth.slowest
    assert (bound <= least).all()
    assert (bound > 0.8 * least).all()


def test_a_level_is_the_mean_of_the_one_below(device):
    stage = SmoothStage(device, sheet(), noise())
    found = stage.stretch(bent(stage.mesh))
    fine = stage.convolved(found)
    a, b, c, d = (fine[y::2, x::2] for y in (0, 1) for x in (0, 1))
    coarse = stage.convolved(found, 0, 0, R // 2, level=1)
    np.testing.assert_array_equal(coarse, np.float32(0.25) * ((a + b) + (c + d)))


@MODELS
def test_the_neutral_frame_is_the_neutral_map_bit_for_bit(device, model):
    stage = SmoothStage(device, sheet(), noise())
    np.testing.assert_array_equal(stage.frame(None, model), stage.heights)


@MODELS
def test_a_rigid_motion_is_the_neutral_up_to_the_rounding_of_positions(device, model):
    stage = SmoothStage(device, sheet(), noise())
    found = stage.frame(rotate_translate(stage.mesh.positions, 5), model)
    assert 0 < np.abs(found - stage.heights).max() <= 1e-4


def test_signs_of_axes_change_no_bit(device):
    stage = SmoothStage(device, sheet(), noise())
    found = stage.stretch(bent(stage.mesh))
    axes = device.read(found.axes, (found.count, 4), np.float32)
    plain = stage.convolved(found)
    for signs in ([-1, -1, 1, 1], [1, 1, -1, -1]):
        turned = replace(found, axes=device.upload(axes * np.float32(signs)))
        np.testing.assert_array_equal(stage.convolved(turned), plain)


@pytest.mark.parametrize(("stretched", "waves"), [(0, 1), (1, 0)], ids=["along u", "along v"])
@pytest.mark.parametrize("ratio", [0.8, 1.2])
@MODELS
def test_a_wave_along_the_stretch_changes_as_the_transform_says(
    device, stretched, waves, ratio, model
):
    sigma, frequency = 3.0, 1 / 16
    wave = np.cos(2 * np.pi * frequency * (np.arange(R) + 0.5))
    across = np.broadcast_to(wave if stretched == 0 else wave[:, None], (R, R))
    stage = SmoothStage(device, square(), across, sigma / R)
    positions = stage.mesh.positions.copy()
    scaled = slice(None, 2) if model == "tension" else stretched  # which is even
    positions[:, scaled] *= np.float32(ratio)
    found = stage.frame(positions, model)
    alpha = float(np.clip(4.0 * np.log(ratio), -1, 1))
    relief = convolve.gain(alpha, sigma, frequency)
    assert (relief < 0.8) if ratio > 1 else (relief > 1.2)
    inside = (slice(16, -16), slice(16, -16))  # the border repeats its texel
    np.testing.assert_allclose(found[inside], relief * across[inside], atol=1e-5)


def flat_patch():
    """A flat sheet whose UV are a similar image of its positions, and a linear deformation."""
    positions, faces, _, _ = bumpy_grid(10)
    flat = positions * np.float32([1, 1, 0])
    plane = flat[:, :2] @ np.array([[0.3, 0.1], [-0.05, 0.2]]) + 0.5
    deformation = np.array([[1.2, 0.15, 0.1], [-0.1, 0.9, 0.05], [0, 0, 1]])
    return Mesh(flat, faces, plane, faces), (flat @ deformation).astype(np.float32)


def test_smooth_is_nearest_where_a_flat_patch_is_deformed_linearly(device):
    mesh, positions = flat_patch()
    one, other = (kind(device, mesh, noise(), 0.05) for kind in (Stage, SmoothStage))
    nearest, found = one.frame(positions), other.frame(positions)
    assert np.abs(nearest - one.heights).max() > 0.1
    assert np.abs(found - nearest).max() <= BOUND


def steepest(stage, positions, model):
    """The largest change from a texel to the next in its row."""
    return np.abs(np.diff(stage.frame(positions, model), axis=1)).max()


@MODELS
def test_no_step_shows_at_the_edges_of_triangles(device, model):
    # A wave along v, whose relief changes along u as the stretch does.
    mesh = square(8)
    wave = np.cos(2 * np.pi / 16 * (np.arange(R)[:, None] + 0.5)) * np.ones((R, R))
    positions = mesh.positions.copy()
    positions[:, 1] *= 1 + 0.2 * np.sin(1.9 * np.pi * mesh.positions[:, 0])
    nearest, smooth = (
        steepest(kind(device, mesh, wave, 3.0 / R), positions, model)
        for kind in (Stage, SmoothStage)
    )
    # 32 texels from one end of an edge to the other.
    assert smooth < nearest / 15


@pytest.mark.parametrize("ratio", [0.8, 1.25])
def test_one_scale_everywhere_has_one_pair_of_axes_everywhere(device, ratio):
    # Axes made of rounding would blur twice in one direction here and not at all there.
    stage = SmoothStage(device, square(), noise(), 3.0 / R)
    positions = rotate_translate(stage.mesh.positions * np.float32(ratio), 5)
    found, wanted = (stage.frame(positions, model) for model in ("tensor", "tension"))
    assert np.abs(wanted - stage.heights).max() > 0.1
    assert np.abs(found - wanted).max() <= 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "make"),
    [
        *[("tensor", sheet), ("tension", square), ("uv", sheet)],
        pytest.param("tensor", square, marks=pytest.mark.slow),
        pytest.param("tension", sheet, marks=pytest.mark.slow),
        pytest.param("uv", square, marks=pytest.mark.slow),
    ],
)
def test_collapsed_and_exploded_frames_give_finite_maps(device, model, make):
    mesh = make()
    stage = SmoothStage(device, mesh, noise(), LARGE)
    exploded = np.random.default_rng(8).normal(size=mesh.positions.shape)
    for positions in (
        0 * mesh.positions, 1e9 * exploded, 1e37 * exploded, mesh.positions * [1, 0, 0]
    ):  # fmt: skip
        found = stage.frame(positions.astype(np.float32), model)
        assert np.isfinite(found).all()
        assert np.abs(found).max() <= 9


@MODELS
def test_texels_in_no_triangle_are_left(device, model):
    stage = SmoothStage(device, flat_patch()[0], noise())
    found = stage.frame(1.5 * stage.mesh.positions, model)
    triangles = device.read(stage.located.texels(R, 0, 0, R), (R, R), np.int32)
    outside = triangles == len(stage.mesh.faces)
    assert 0.1 < outside.mean() < 0.9
    np.testing.assert_array_equal(found[outside], stage.heights[outside])
    assert (found[~outside] != stage.heights[~outside]).mean() > 0.99


def fallen():
    """A sheet of which every ninth triangle has no area in space."""
    mesh = sheet()
    positions = mesh.positions.copy()
    positions[mesh.faces[::9, 1]] = positions[mesh.faces[::9, 0]]
    return Mesh(positions, mesh.faces, mesh.uv, mesh.face_uv)


@MODELS
def test_meshes_with_fallen_triangles_give_finite_maps(device, model):
    stage = SmoothStage(device, fallen(), noise())
    found = stage.frame(bent(sheet()), model)
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= 9


@pytest.mark.slow
@pytest.mark.parametrize("model", ["tensor", "uv"])
def test_fallen_triangles_take_what_is_interpolated_in_them(device, model):
    # With `nearest` sampling they are left as they are.
    mesh, place = fallen(), (96, 48, 48)
    positions = bent(mesh)
    one, other = (kind(device, mesh, noise()) for kind in (Stage, SmoothStage))
    triangles = device.read(other.located.texels(R, *place), (48, 48), np.int32)
    without = np.isin(triangles, np.flatnonzero(~mesh.usable_triangles()))
    assert without.sum() > 200
    heights = noise()[96:144, 48:96]
    nearest, found = (
        stage.frame(positions, model, row=96, column=48, side=48) for stage in (one, other)
    )
    np.testing.assert_array_equal(nearest[without], heights[without])
    wanted, sure = other.expected(positions, model, *place)
    inside = without & sure
    assert inside.sum() > 0.5 * without.sum()
    assert np.abs(found - wanted)[inside].max() <= BOUND
    assert (found != heights)[without].mean() > 0.9


def test_a_larger_mesh_is_the_same_picture(device):
    mesh, maps = sheet(), []
    for factor in (1.0, 2.0**-30, 2.0**30):
        body = Mesh(mesh.positions * np.float32(factor), mesh.faces, mesh.uv, mesh.face_uv)
        stage = SmoothStage(device, body, noise(), SMALL * factor)
        maps.append(stage.frame(bent(mesh, 9) * np.float32(factor)))
    np.testing.assert_array_equal(maps[1], maps[0])
    np.testing.assert_array_equal(maps[2], maps[0])


def test_nothing_is_left_on_the_device(device):
    stage = SmoothStage(device, sheet(), noise())
    found = stage.stretch(bent(stage.mesh))
    used = device.budget.used
    stage.convolved(found)
    assert device.budget.used == used
