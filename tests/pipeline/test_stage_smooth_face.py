"""Smooth sampling on the real face: against the reference, and where frames are broken."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.scenes import EDGE_BAND
from pipeline.smooth_scenes import MODELS, reference_sample, stretch_at
from reference import locate
from reference.bins import layer_stretch
from rhytid.domain.mesh import Mesh

pytestmark = [pytest.mark.face, pytest.mark.slow]
LIMIT = 0.5


@pytest.fixture(scope="module")
def mesh(face):
    return Mesh(face.positions, face.faces, face.uv, face.face_uv)


@pytest.fixture(scope="module")
def places(mesh):
    """Points in random triangles, where the small ones are, and beside the charts."""
    rng = np.random.default_rng(4)
    corners = mesh.triangle_uv()[rng.integers(0, len(mesh.faces), 300)]
    points = np.einsum("pkx,pk->px", corners, rng.dirichlet((1, 1, 1), 300))
    points[::6] += rng.normal(0, 0.003, (50, 2))
    return points[((points > 0) & (points < 1)).all(axis=1)].astype(np.float32).astype(np.float64)


@pytest.fixture(scope="module")
def held(mesh, places):
    """The triangle of each point, and whether that is sure."""
    index, margin = locate.locate(places, mesh.triangle_uv(), 16 / 256)
    return index, (margin > EDGE_BAND) & (index >= 0)


@pytest.mark.parametrize("model", MODELS)
def test_log_stretch_is_that_of_double(device, mesh, face, places, held, model):
    index, sure = held
    assert sure.mean() > 0.9
    positions = face.composite("smile")
    logs, axes = reference_sample(mesh, positions, model, places, index)
    wanted = layer_stretch(logs, axes, 2)[[1, 0, 2]].T  # along u, along v, of a pore
    found = stretch_at(device, mesh, positions, places, model)
    assert np.abs(wanted).max() > 0.3
    assert np.abs(found - wanted)[sure].max() <= 2e-6


@pytest.mark.parametrize("model", MODELS)
def test_broken_frames_stay_within_the_limit(device, mesh, places, model):
    rng = np.random.default_rng(5)
    wild = mesh.positions + rng.normal(0, 10, mesh.positions.shape).astype(np.float32)
    flat = mesh.positions * np.float32([1, 1, 0])
    for positions in (np.zeros_like(wild), flat, wild, wild * np.float32(1e15)):
        found = stretch_at(device, mesh, positions, places, model)
        assert np.isfinite(found).all()
        assert np.abs(found).max() <= LIMIT + 1e-6
