"""Angles on the surface of the real face: against the reference, and where frames are broken."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.scenes import EDGE_BAND, MODELS, random_graph, settings_of
from pipeline.stiff_scenes import SAMPLINGS, StiffScene, painted
from reference import locate, redraw, stiffness
from reference.response import on_surface, wrinkle_stretch
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.redraw import respond
from rhytid.pipeline.smooth import respond_smooth

pytestmark = [pytest.mark.face, pytest.mark.slow]
SETTINGS = settings_of(angles="surface", response={"alpha_w": 1.0})


class FaceScene(StiffScene):
    """Wrinkles on the real face, those alone whose triangle is sure."""

    def __init__(self, device, face):
        graph = random_graph(5, 600, length=(0.005, 0.02))
        mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
        super().__init__(device, mesh, graph, SETTINGS, painted())
        _, margin = locate.locate(self.middles, mesh.triangle_uv(), 16 / 256)
        inside = ((self.middles >= 0) & (self.middles < 1)).all(axis=1)
        self.sure = (margin > EDGE_BAND) & inside & (self.graph.edge_weight > 0)

    def r(self, positions, model, sampling):
        """(M,) of the product, read off the widths; NaN for wrinkles that are not drawn."""
        elements = self.elements()
        if sampling == "smooth":
            fields = self.fields(positions, model)
            scales = respond_smooth(self.device, elements, self.located, self.settings, fields)
        else:
            stretch = self.stretch(positions, model)
            scales = respond(self.device, elements, self.settings, stretch)
        count = elements.wrinkles
        widths = self.device.read(scales.wrinkles, (count, 2), np.float32)[:, 0]
        segments = self.device.read(elements.segments, (count, 4), np.float32)
        starts = self.graph.node_uv[self.graph.edge_nodes[:, 0]] * np.float32(256)
        place = {tuple(start): i for i, start in enumerate(starts.tolist())}
        found = np.full(len(starts), np.nan)
        found[[place[tuple(start)] for start in segments[:, :2].tolist()]] = np.log(widths)
        return found

    def expected_r(self, positions, model, sampling):
        logs, axes, jacobian = self.reference_at(
            self.middles, self._wrinkle, positions, model, sampling
        )
        k = stiffness.at_elements(self.maps(), self.middles, self._wrinkle, self.mesh.triangle_uv())
        theta = on_surface(jacobian, redraw.directions(self.graph))
        return wrinkle_stretch(logs * k[:, None], on_surface(jacobian[:, None], axes), theta)


@pytest.fixture(scope="module")
def made(device, face):
    return FaceScene(device, face)


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("model", MODELS)
def test_log_stretch_is_that_of_double(made, face, model, sampling):
    positions = face.composite("smile")
    found, wanted = (f(positions, model, sampling) for f in (made.r, made.expected_r))
    sure = made.sure & np.isfinite(found)
    assert sure.sum() > 400
    assert np.abs(wanted[sure]).max() > 0.2
    assert np.abs(found - wanted)[sure].max() <= 1e-5


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("model", MODELS)
def test_broken_frames_stay_within_the_limit(made, face, model, sampling):
    rng = np.random.default_rng(5)
    wild = face.positions + rng.normal(0, 10, face.positions.shape).astype(np.float32)
    for positions in (np.zeros_like(wild), wild * np.float32([1, 1, 0]), wild * np.float32(1e15)):
        found = made.r(positions, model, sampling)
        drawn = found[~np.isnan(found)]
        assert len(drawn) > 400
        assert np.abs(drawn).max() <= 0.5 + 1e-6
