"""Scenes with a painted stiffness, or with angles on the surface: both sides of them."""

from __future__ import annotations

import numpy as np

from pipeline.binned import TILE, BinnedScene
from pipeline.scenes import DEPTH
from pipeline.smooth_scenes import LIMIT, mesh_of, reference_fields, reference_sample
from reference import bins, drawing, locate, redraw, smooth, stiffness, stretch
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.bin_maker import BinMaker
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.element_arrays import pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import render_to_host
from rhytid.pipeline.locate import locate_points
from rhytid.pipeline.redraw import redrawing, respond
from rhytid.pipeline.smooth import SmoothStage, respond_smooth
from rhytid.pipeline.stiffness import stiffness_of_elements

SAMPLINGS = ("nearest", "smooth")


def painted(shape=(9, 12), udims=(1001,), seed=3):
    """Stiffness whose texels are far coarser than a tile's, some 0 and some 1."""
    rng = np.random.default_rng(seed)
    return Stiffness({u: np.clip(rng.uniform(-0.3, 1.3, shape), 0, 1) for u in udims})


class StiffScene(BinnedScene):
    """A scene whose stiffness is `stiffness`, by either sampling."""

    def __init__(self, device, mesh, graph, settings, stiffness=None, at=(64, 128), udim=1001):
        super().__init__(device, mesh, graph, settings, at, udim)
        self.at, self.stiffness = at, stiffness
        maker = BinMaker(device, self.elements(udim), self.located, settings, stiffness)
        self.tile = maker.tile(*at, TILE)

    def elements(self, udim=1001):
        settings, mesh = self.settings, self.mesh
        stiff = getattr(self, "stiffness", None)
        arrays = []
        for uv, make in ((self.middles, wrinkle_arrays), (self.graph.node_uv, pore_arrays)):
            found = locate_points(self.device, mesh, uv, settings.resolution, settings.padding)
            k = stiffness_of_elements(stiff, mesh, uv, found)
            arrays.append(make(self.graph, found, settings, udim, k))
        return UdimElements(self.device, *arrays, settings.bins.count)

    def fields(self, positions, model):
        stage = SmoothStage(self.device, self.mesh)
        return stage.run(self.stretch(positions, model), LIMIT)

    def redrawn_by(self, positions, model, sampling, udim=1001):
        """(R, R)"""
        elements, settings = self.elements(udim), self.settings
        if sampling == "smooth":
            fields = self.fields(positions, model)
            scales = respond_smooth(self.device, elements, self.located, settings, fields)
        else:
            scales = respond(self.device, elements, settings, self.stretch(positions, model))
        draw = redrawing(self.device, elements, settings, scales)
        return render_to_host(self.device, draw, 0, 0, 0, settings.resolution)

    def blended_by(self, positions, model, sampling):
        """(P,) of the tile."""
        blend = Blend(self.device, self.settings, len(self.mesh.faces))
        stretch = self.stretch(positions, model)
        if sampling == "smooth":
            out = blend.smooth_tile(self.tile, self.fields(positions, model), self.located)
        elif self.tile.stiffness is not None:
            out = blend.stiff_tile(self.tile, blend.stretches(stretch))
        else:
            out = blend.tile(self.tile, blend.coefficients(stretch))
        return self.device.read(out, (TILE * TILE,), np.float32)

    def reference_at(self, points, index, positions, model, sampling):
        """Log stretch (P, 2), axes (P, 2, 2) and J (P, k, 2) at points with UDIM of triangles."""
        if sampling == "smooth":
            logs, axes = reference_sample(self.mesh, positions, model, points, index)
            return logs, axes, self.smooth_jacobian(points, index)
        logs, axes = locate.sample(index, *self.reference_logs(positions, model))
        jacobian = stretch.jacobians(*mesh_of(self.mesh))[index]
        jacobian[index < 0] = np.eye(jacobian.shape[1], 2)
        return logs, axes, jacobian

    def smooth_jacobian(self, points, index):
        """A J (P, 2, 2) with JᵀJ the interpolated metric of the neutral."""
        owner = smooth.corners(*mesh_of(self.mesh)[1:])[1]
        metric = reference_fields(self.mesh, self.mesh.positions, "tensor")[0]
        uv = self.mesh.triangle_uv()
        (found,) = smooth.interpolated(points, index, uv, owner, (metric,))
        return np.swapaxes(np.linalg.cholesky(found), 1, 2)

    def maps(self):
        return {} if self.stiffness is None else self.stiffness.maps

    def expected_redraw(self, points, positions, model, sampling, udim=1001):
        """(P,) at points local to the UDIM."""
        sampled = []
        for uv, index in ((self.middles, self._wrinkle), (self.graph.node_uv, self._pore)):
            logs, axes, jacobian = self.reference_at(uv, index, positions, model, sampling)
            k = stiffness.at_elements(self.maps(), uv, index, self.mesh.triangle_uv())
            sampled.append((logs * k[:, None], axes, jacobian))
        (*wrinkles, jacobian), (*pores, _) = sampled
        settings = self.settings
        jacobian = jacobian if settings.angles == "surface" else None
        return redraw.redraw(
            points, self.graph, wrinkles, pores, settings.response, settings.shape, DEPTH,
            udim_origin(udim), jacobian,
        )  # fmt: skip

    def expected_blend(self, positions, model, sampling):
        """(P,) from the product's own codes, and whether a texel's triangle is sure."""
        settings = self.settings
        index, margin = locate.locate(
            self.points + udim_origin(self.udim), self.mesh.triangle_uv(),
            settings.padding / settings.resolution,
        )  # fmt: skip
        points = self.points + udim_origin(self.udim)
        logs, axes, jacobian = self.reference_at(points, index, positions, model, sampling)
        map = self.maps().get(self.udim)
        k = 1.0 if map is None else stiffness.bilinear(map, self.points)[:, None]
        jacobian = jacobian if settings.angles == "surface" else None
        r = bins.layer_stretch(logs * k, axes, settings.bins.count, jacobian)
        layers = [maps.astype(np.int64) for maps in self.layers()]
        tilted = None
        if settings.bins.tilt:
            sides = bins.sides_of(logs * k, axes, settings.bins.count, jacobian)
            tilted = bins.Tilts(self.tilts().astype(np.int64), *sides)
        found = bins.blend(
            layers, r, settings.response, settings.shape, settings.bins, DEPTH, tilted
        )
        return found, margin > 1e-6


def window():
    """Points of rows 96 to 160, columns 32 to 96, of 256."""
    return drawing.crop(96, 32, 64, 64, 256), (slice(96, 160), slice(32, 96))
