"""The convolved map of skin that is partly rigid, against the reference."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import deform
from pipeline.convolving import BOUND, LARGE, SMALL, R, SmoothStage, Stage, noise, square
from pipeline.scenes import sheet
from pipeline.stiff_scenes import painted
from reference import convolve, stretch
from reference.drawing import crop
from reference.stiffness import bilinear
from rhytid.domain.painted_maps import Stiffness


def frame(stage):
    return stage.stretch(deform(stage.mesh.positions, 3, 0.15))


def expected(stage, found):
    """The reference with the product's stretch and triangles, alpha by texel."""
    count, settings, mesh = found.count, stage.settings.convolve, stage.mesh
    axes = stage.device.read(found.axes, (count, 2, 2), np.float32).astype(np.float64)
    logs = stage.device.read(found.logs, (count, 2), np.float32).astype(np.float64)
    jacobian = stretch.jacobians(mesh.positions, mesh.faces, mesh.uv, mesh.face_uv)
    sigma = np.ones((count, 2))
    sigma[:-1] = convolve.deviation(jacobian, axes[:-1], settings.sigma, R)
    triangles = stage.device.read(stage.located.texels(R, 0, 0, R), (R, R), np.int32)
    stiffness = bilinear(stage.stiffness.maps[1001], crop(0, 0, R, R, R)).reshape(R, R, 1)
    alpha = convolve.share(logs[triangles] * stiffness, settings.blur_gain, settings.sharpen_gain)
    return convolve.convolved(
        stage.heights.astype(np.float64), axes[triangles], alpha, sigma[triangles]
    )


@pytest.mark.parametrize(
    ("sigma", "gain"),
    [
        *[(SMALL, 30.0), (LARGE, 4.0)],
        *(pytest.param(*both, marks=pytest.mark.slow) for both in [(SMALL, 4.0), (LARGE, 30.0)]),
    ],
)
def test_the_map_is_that_of_double(device, sigma, gain):
    gains = {"blur_gain": gain, "sharpen_gain": gain}
    stage = Stage(device, sheet(), noise(), sigma, painted(), **gains)
    plain = Stage(device, sheet(), noise(), sigma, **gains)
    found = frame(stage)
    convolved = stage.convolved(found)
    assert np.abs(convolved - plain.convolved(found)).max() > 0.1
    # With a gain of 30 alpha turns from -1 to 1 within a fifteenth of log stretch.
    assert np.abs(convolved - expected(stage, found)).max() <= BOUND


@pytest.mark.slow
@pytest.mark.parametrize("gain", [4.0, 30.0])
def test_a_tile_of_smooth_sampling_is_that_of_double(device, gain):
    stage = SmoothStage(
        device, sheet(), noise(), SMALL, painted(), blur_gain=gain, sharpen_gain=gain
    )
    positions = deform(stage.mesh.positions, 3, 0.15)
    found = stage.frame(positions, row=96, column=128, side=48)
    wanted, sure = stage.expected(positions, "tensor", 96, 128, 48)
    assert sure.mean() > 0.5
    assert np.abs(found - wanted)[sure].max() <= BOUND


@pytest.mark.parametrize("kind", [Stage, SmoothStage])
@pytest.mark.parametrize("mesh", [sheet(), square()], ids=["charts", "up to the border"])
def test_a_tile_is_the_crop_of_the_map_bit_for_bit(device, mesh, kind):
    map = np.ones((8, 8), np.float32)
    map[:5, :5] = painted((5, 5)).maps[1001]  # tiles without a stiffness below 1, too
    stage = kind(device, mesh, noise(), SMALL, Stiffness({1001: map}))
    found = frame(stage)
    whole = stage.convolved(found)
    for row in range(0, R, 64):
        for column in range(0, R, 64):
            tile = stage.convolved(found, row, column, 64)
            np.testing.assert_array_equal(tile, whole[row : row + 64, column : column + 64])


@pytest.mark.parametrize("kind", [Stage, SmoothStage])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_rigid_is_the_neutral_and_1_is_the_paper_bit_for_bit(device, value, kind):
    stage = kind(device, sheet(), noise(), SMALL, Stiffness({1001: np.full((3, 2), value)}))
    plain = kind(device, sheet(), noise())
    wanted = plain.convolved(frame(plain)) if value else noise()
    np.testing.assert_array_equal(stage.convolved(frame(stage)), wanted)
