"""The convolved map on the real face: crops against the reference, and no frame that breaks it."""

from __future__ import annotations

import numpy as np
import pytest

import face_data
from pipeline.scenes import settings_of
from reference import convolve, stretch
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.convolve import MOST_TAPS, Convolve
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.stretch import StretchStage

pytestmark = [pytest.mark.face, pytest.mark.slow]
R, SIDE, AROUND = 1024, 64, 2 * (MOST_TAPS + 1)
SIGMA = 0.06  # cm
BOUND = 5e-5
# Forehead, eye corner, mouth corner, chin: (row, column).
CROPS = {"brow": (320, 448), "eye": (384, 320), "mouth": (576, 448), "chin": (704, 512)}
HEIGHTS = np.random.default_rng(1).uniform(-1, 1, (R, R)).astype(np.float32)


class FaceStage:
    """The face on the device, and noise in place of its neutral map."""

    def __init__(self, device, face):
        self.device = device
        self.mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
        self.settings = settings_of(resolution=R, convolve={"sigma": SIGMA})
        self.stage, self.convolve = StretchStage(device, self.mesh), Convolve(device, self.mesh)
        self.located = UdimTriangles(device, self.mesh, 1001, R, 16)
        self.jacobians = stretch.jacobians(
            self.mesh.positions, self.mesh.faces, self.mesh.uv, self.mesh.face_uv
        )

    def neutral(self, row, column, side):
        def draw(row, column, side):
            return self.device.upload(HEIGHTS[row : row + side, column : column + side])

        return self.convolve.neutral_tile(
            draw, self.located, self.settings, 1001, row, column, side
        )

    def convolved(self, stretch, neutral):
        kernels = self.convolve.kernels(stretch, self.settings)
        out = self.convolve.tile(neutral, kernels, self.settings)
        found = self.device.read(out, (neutral.side, neutral.side), np.float32)
        kernels.release()
        out.release()
        return found

    def expected(self, found, row, column):
        """The reference with the product's stretch and triangles."""
        wide = SIDE + 2 * AROUND
        at = self.located.texels(R, row - AROUND, column - AROUND, wide)
        triangles = self.device.read(at, (wide, wide), np.int32)
        axes, logs = (
            self.device.read(values, (found.count, *shape), np.float32).astype(np.float64)
            for values, shape in ((found.axes, (2, 2)), (found.logs, (2,)))
        )
        sigma = np.ones((found.count, 2))
        sigma[:-1] = convolve.deviation(self.jacobians, axes[:-1], SIGMA, R)
        taps = 3 * sigma[np.unique(triangles)]
        # A last tap that rounding could take away would leave both sides right.
        assert np.abs(taps - np.rint(taps))[taps < MOST_TAPS].min() > 1e-5
        alpha = convolve.share(logs, 4.0, 4.0)
        rows, columns = (np.arange(x - AROUND, x - AROUND + wide) for x in (row, column))
        heights = HEIGHTS[np.ix_(rows, columns)].astype(np.float64)
        full = convolve.convolved(heights, *(x[triangles] for x in (axes, alpha, sigma)))
        return full[AROUND:-AROUND, AROUND:-AROUND]


@pytest.fixture(scope="module")
def stage(device, face):
    return FaceStage(device, face)


@pytest.mark.parametrize("model", ["tensor", "tension", "uv"])
@pytest.mark.parametrize("crop", CROPS)
def test_crops_are_those_of_double(stage, face, crop, model):
    found = stage.stage.run(face.composite("smile"), 0.5, model)
    convolved = stage.convolved(found, stage.neutral(*CROPS[crop], SIDE))
    wanted = stage.expected(found, *CROPS[crop])
    found.release()
    assert np.abs(convolved - wanted).max() <= BOUND


def test_every_composite_and_captured_frames_give_finite_maps(stage, face):
    count = len(face_data.performance()[1])
    captured = [face.captured(i) for i in range(0, count, count // 4)]
    frames = [*map(face.composite, face.composites), *captured, 0 * face.positions]
    neutral = stage.neutral(0, 0, R)
    for positions in frames:
        for model in ("tensor", "tension", "uv"):
            found = stage.stage.run(positions, 0.5, model)
            convolved = stage.convolved(found, neutral)
            found.release()
            assert np.isfinite(convolved).all()
            assert np.abs(convolved).max() <= 9
    neutral.release()
