"""Angles in the neutral tangent plane, against the reference, and what they hang on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pairs import pairs
from pipeline.scenes import DEPTH, MODELS, random_graph, settings_of, sheet
from pipeline.stiff_scenes import SAMPLINGS, StiffScene, painted, window
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.redraw import respond

GRAPH = random_graph(22, 240)
CHOICES = ({}, {"merge": "soft", "depth_factored": True, "tilt": True})
# One of them in the quick tests.
ONE_QUICK = [SAMPLINGS[0], *(pytest.param(more, marks=pytest.mark.slow) for more in SAMPLINGS[1:])]


def sheared(factor=3.0):
    """The sheet with UV that are narrow and oblique, so that angles in UV are far from those on
    the surface."""
    mesh = sheet()
    turn = np.array([[1.0, 0.0], [0.4, 1.0 / factor]])
    return Mesh(mesh.positions, mesh.faces, mesh.uv @ turn.T * 0.6 + 0.1, mesh.face_uv)


def scene(device, angles="surface", mesh=None, stiffness=None, **more):
    settings = settings_of(angles=angles, **more)
    return StiffScene(device, mesh or sheared(), GRAPH, settings, stiffness)


def bent(made):
    return deform(made.mesh.positions, 5, 0.15)


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("model", MODELS)
def test_redrawn_maps_are_those_of_double(device, model, sampling):
    made = scene(device, stiffness=painted())
    points, place = window()
    wanted = made.expected_redraw(points, bent(made), model, sampling).reshape(64, 64)
    found = made.redrawn_by(bent(made), model, sampling)[place]
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH


@pytest.mark.parametrize(("choice", "stiff", "sampling"), pairs(CHOICES, [False, True], SAMPLINGS))
def test_blended_tiles_are_those_of_double(device, choice, stiff, sampling):
    made = scene(device, stiffness=painted() if stiff else None, bins={"r_max": 0.3, **choice})
    for model in MODELS:
        wanted, sure = made.expected_blend(bent(made), model, sampling)
        found = made.blended_by(bent(made), model, sampling)
        assert sure.mean() > 0.9
        assert np.abs(found - wanted)[sure].max() <= 2e-4 * DEPTH


@pytest.mark.parametrize("sampling", ONE_QUICK)
def test_they_are_not_those_of_uv(device, sampling):
    for model in ("tensor", "uv"):
        for draw in ("redrawn_by", "blended_by"):
            found, other = (
                getattr(made, draw)(bent(made), model, sampling)
                for made in (scene(device), scene(device, "uv"))
            )
            assert np.abs(found - other).max() > 0.02 * DEPTH


@pytest.mark.parametrize("sampling", ONE_QUICK)
def test_on_a_flat_square_both_are_the_same(device, sampling):
    lattice = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 9)]), axis=-1).reshape(-1, 2)
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1, 1)
    faces = np.concatenate([corner + np.array([0, 1, 10]), corner + np.array([0, 10, 9])])
    flat = Mesh(np.pad(5.0 * lattice, ((0, 0), (0, 1))), faces, lattice, faces)
    for model in MODELS:
        for draw in ("redrawn_by", "blended_by"):
            found, other = (
                getattr(made, draw)(bent(made), model, sampling)
                for made in (scene(device, angles, flat) for angles in ("surface", "uv"))
            )
            np.testing.assert_allclose(found, other, atol=1e-4 * DEPTH, rtol=0)


def test_shearing_the_uv_changes_no_angle_on_the_surface(device):
    """A wrinkle keeps its r whatever the UV do, as long as it runs the same way on the surface."""
    mesh, factor = sheet(), np.array([[0.5, 0.1], [0.0, 0.25]])
    moved = Mesh(mesh.positions, mesh.faces, mesh.uv @ factor.T, mesh.face_uv)
    rng = np.random.default_rng(8)
    place = mesh.triangle_uv().mean(axis=1)[rng.integers(0, len(mesh.faces), 60)]
    along = rng.normal(size=(60, 2)) * 1e-3
    scales = []
    for made, turn in ((mesh, np.eye(2)), (moved, factor)):
        ends = np.concatenate([place - along, place + along]) @ turn.T
        scales.append(widths(device, made, ends))
    assert np.ptp(scales[0]) > 0.05
    np.testing.assert_allclose(*scales, rtol=1e-4)


def widths(device, mesh, ends):
    """(M,) width scales of wrinkles between the first and the second half of `ends`."""
    count = len(ends) // 2
    graph = replace(
        random_graph(1, count),
        node_uv=ends.astype(np.float32),
        edge_weight=np.ones(count, np.float32),
    )
    made = StiffScene(device, mesh, graph, settings_of(angles="surface"))
    elements = made.elements()
    assert elements.wrinkles == count
    scales = respond(device, elements, made.settings, made.stretch(bent(made)))
    found = device.read(scales.wrinkles, (count, 2), np.float32)[:, 0]
    return np.sort(found)  # the elements of a UDIM are sorted by place
