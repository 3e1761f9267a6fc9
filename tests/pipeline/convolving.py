"""A mesh with noise in place of its neutral map, and what `convolved` makes of it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from pipeline.scenes import settings_of
from pipeline.smooth_scenes import mesh_of, reference_fields
from reference import convolve, drawing, stretch
from reference import smooth as reference
from reference.stiffness import bilinear
from rhytid.domain.mesh import Mesh
from rhytid.pipeline import smooth
from rhytid.pipeline.convolve import MOST_TAPS, Convolve, SmoothConvolve
from rhytid.pipeline.levels import render_to_host
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.stretch import StretchStage

R = 256
# What a tap is off: its weight by 3e-4 at most, its place by 1e-5 of a texel; two passes.
BOUND = 5e-5
# One unit of length is R texels on the square, about 70 on the sheet.
SMALL, LARGE = 0.02, 0.4


def noise(seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (R, R)).astype(np.float32)


def square(n=4):
    """The unit square over the whole UDIM, x along u and y along v."""
    lattice = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, n + 1)]), axis=-1).reshape(-1, 2)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    lower, upper = np.array([0, 1, n + 2]), np.array([0, n + 2, n + 1])
    faces = np.concatenate([corner + lower, corner + upper])
    positions = np.concatenate([lattice, np.zeros((len(lattice), 1))], axis=1)
    return Mesh(positions, faces, lattice, faces)


class Stage:
    """A mesh on the device, and any map of R² texels in place of its neutral one."""

    def __init__(self, device, mesh, heights, sigma=SMALL, stiffness=None, **changes):
        self.device, self.mesh, self.heights = device, mesh, np.float32(heights)
        self.settings = settings_of(resolution=R, convolve={"sigma": sigma, **changes})
        self.stage = StretchStage(device, mesh)
        self.convolve, self.stiffness = Convolve(device, mesh, stiffness), stiffness
        self.located = UdimTriangles(device, mesh, 1001, R, self.settings.padding)

    def stretch(self, positions, model="tensor"):
        return self.stage.run(positions, self.settings.response.log_stretch_limit, model)

    def draw(self, row, column, side):
        assert min(row, column) >= 0
        assert max(row, column) + side <= R
        return self.device.upload(self.heights[row : row + side, column : column + side])

    def convolved(self, stretch, row=0, column=0, side=R, level=0):
        kernels = self.convolve.kernels(stretch, self.settings)
        found = self._drawn(
            lambda neutral: self.convolve.tile(neutral, kernels, self.settings),
            (level, row, column, side),
        )
        kernels.release()
        return found

    def _drawn(self, tile, place):
        def draw(row, column, side):
            neutral = self.convolve.neutral_tile(
                self.draw, self.located, self.settings, 1001, row, column, side
            )
            out = tile(neutral)
            neutral.release()
            return out

        return render_to_host(self.device, draw, *place)

    def frame(self, positions, model="tensor", **crop):
        return self.convolved(self.stretch(positions, model), **crop)

    def expected(self, found):
        """The reference with the product's stretch and triangles."""
        count = found.count
        axes = self.device.read(found.axes, (count, 2, 2), np.float32).astype(np.float64)
        logs = self.device.read(found.logs, (count, 2), np.float32)
        mesh, settings = self.mesh, self.settings.convolve
        jacobian = stretch.jacobians(mesh.positions, mesh.faces, mesh.uv, mesh.face_uv)
        sigma = np.ones((count, 2))
        sigma[:-1] = convolve.deviation(jacobian, axes[:-1], settings.sigma, R)
        # A last tap that rounding could take away would leave both sides right.
        taps = 3 * sigma[:-1]
        assert np.abs(taps - np.rint(taps))[taps < MOST_TAPS].min(initial=1.0) > 1e-4
        alpha = convolve.share(logs, settings.blur_gain, settings.sharpen_gain)
        triangles = self.device.read(self.located.texels(R, 0, 0, R), (R, R), np.int32)
        heights = self.heights.astype(np.float64)
        return convolve.convolved(heights, *(x[triangles] for x in (axes, alpha, sigma)))


class SmoothStage(Stage):
    """The same with stretch of its own for every texel."""

    def __init__(self, device, mesh, heights, sigma=SMALL, stiffness=None, **changes):
        super().__init__(device, mesh, heights, sigma, stiffness, **changes)
        self.smooth = smooth.SmoothStage(device, mesh)
        self.convolve = SmoothConvolve(device, mesh, self.smooth, stiffness)

    def convolved(self, stretch, row=0, column=0, side=R, level=0):
        fields = self.smooth.run(stretch, self.settings.response.log_stretch_limit)
        found = self._drawn(
            lambda neutral: self.convolve.tile(neutral, fields, self.located, self.settings),
            (level, row, column, side),
        )
        fields.release()
        return found

    def expected(self, positions, model, row, column, side):
        """(side, side) by the reference, and which texels no rounding can make another."""
        around = 2 * self.convolve.apron(self.settings, 1001, row, column, side)
        wide = side + 2 * around
        triangles = self.located.texels(R, row - around, column - around, wide)
        triangle = self.device.read(triangles, (wide * wide,), np.int32)
        triangle[triangle == len(self.mesh.faces)] = -1
        points = drawing.crop(row - around, column - around, wide, wide, R)
        metric, logs, axes = reference_forms(self.mesh, positions, model, points, triangle)
        if self.stiffness is not None:
            logs = logs * bilinear(self.stiffness.maps[1001], points)[:, None]
        settings = self.settings.convolve
        sigma = convolve.deviation_in(metric, axes, settings.sigma, R)
        alpha = convolve.share(logs, settings.blur_gain, settings.sharpen_gain)
        rows, columns = (np.arange(x - around, x - around + wide) for x in (row, column))
        heights = self.heights[np.ix_(rows, columns)].astype(np.float64)
        full = (x.reshape(wide, wide, *x.shape[1:]) for x in (axes, alpha, sigma))
        inside = np.s_[around:-around, around:-around]
        # A last tap that rounding could take away, of the first pass for all that read it.
        last = (np.abs(3 * sigma - np.rint(3 * sigma)) < 2e-5) & (alpha != 0)
        first, second = np.moveaxis(last.reshape(wide, wide, 2), -1, 0)
        reach = maximum_filter(first, size=2 * int(3 * sigma.max()) + 3)
        return convolve.convolved(heights, *full)[inside], ~(reach | second)[inside]


def reference_forms(mesh, positions, model, points, triangle):
    """G (P, 2, 2), log ρ (P, 2) and axes (P, 2, 2) at points in triangles (-1: none)."""
    owner = reference.corners(*mesh_of(mesh)[1:])[1]
    place = (points, triangle, mesh.triangle_uv(), owner)
    fields = reference_fields(mesh, positions, model)
    metrics = reference_fields(mesh, mesh.positions, "tensor")
    metric = reference.interpolated(*place, metrics)[0]
    if model == "tensor":
        return metric, *reference.sample(*place, fields)
    logs = np.einsum("pii->pi", reference.interpolated(*place, fields)[1])
    return metric, logs, np.broadcast_to(np.eye(2), (len(points), 2, 2))
