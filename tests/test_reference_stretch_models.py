"""The reference of mesh tension and of stretch along u and v against what is known without it."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import SmallMesh, deform, rotate_translate
from reference.stretch import stretch
from reference.stretch_models import tension, uv_stretch

MODELS = (tension, uv_stretch)
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = SQUARE[:, :2] * 0.5 + 0.1


@pytest.mark.parametrize("model", MODELS)
def test_a_rigid_motion_is_no_stretch_and_growth_is_the_growth(small_mesh: SmallMesh, model):
    moved = rotate_translate(small_mesh.positions, 5)
    np.testing.assert_allclose(model(*small_mesh, moved)[0], 1, atol=5e-6)
    for scale in (1e-9, 0.5, 3.0, 1e9):
        grown = small_mesh.positions * np.float64(scale)
        np.testing.assert_allclose(model(*small_mesh, grown)[0], scale, rtol=1e-12)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("model", MODELS)
def test_unit_of_length_does_not_matter(small_mesh: SmallMesh, unit, model):
    deformed = deform(small_mesh.positions, 3).astype(np.float64)
    scaled = small_mesh._replace(positions=small_mesh.positions * np.float64(unit))
    found = model(*scaled, deformed * unit)[0]
    np.testing.assert_allclose(found, model(*small_mesh, deformed)[0], rtol=1e-12)


def test_stretch_along_the_axes_of_uv():
    ratios, axes = uv_stretch(SQUARE, FACES, UV, FACES, SQUARE * (3, 0.5, 1))
    np.testing.assert_allclose(ratios, [[3, 0.5]] * 2, rtol=1e-14)
    np.testing.assert_array_equal(axes, [np.eye(2)] * 2)
    sheared = SQUARE + SQUARE[:, 1:2] * (0.75, 0, 0)
    ratios, _ = uv_stretch(SQUARE, FACES, UV, FACES, sheared)
    np.testing.assert_allclose(ratios, [[1, 1.25]] * 2, rtol=1e-14)


def test_stretch_along_uv_lies_between_the_ratios_of_the_tensor(small_mesh: SmallMesh):
    deformed = deform(small_mesh.positions, 4, 0.3)
    principal, _ = stretch(*small_mesh, deformed)
    found, _ = uv_stretch(*small_mesh, deformed)
    assert (found <= principal[:, :1] * (1 + 1e-12)).all()
    assert (found >= principal[:, 1:] * (1 - 1e-12)).all()


def test_tension_is_the_mean_of_edges_then_the_mean_of_logs():
    # Twice as wide: sides along x by 2, along y by 1, the diagonal by sqrt(5/2).
    ratios, axes = tension(SQUARE, FACES, UV, FACES, SQUARE * (2, 1, 1))
    ends, others = (2 + 1 + np.sqrt(2.5)) / 3, 1.5  # with the diagonal, and without
    expected = (ends * others * ends) ** (1 / 3)
    np.testing.assert_allclose(ratios, expected, rtol=1e-14)
    np.testing.assert_array_equal(axes, [np.eye(2)] * 2)


def test_a_doubled_triangle_changes_no_tension():
    doubled = np.vstack([FACES, FACES, FACES[:, ::-1]])
    wide = SQUARE * (2, 1, 1)
    once = tension(SQUARE, FACES, UV, FACES, wide)[0]
    np.testing.assert_array_equal(tension(SQUARE, doubled, UV, doubled, wide)[0][:2], once)


def test_what_has_no_size_does_not_stretch():
    flat = np.array([[0, 1, 2], [0, 0, 1]])
    ratios, _ = uv_stretch(SQUARE, flat, UV, flat, SQUARE * 7)
    np.testing.assert_allclose(ratios, [[7, 7], [1, 1]], rtol=1e-14)
    line = np.array([[0, 0, 0]])
    np.testing.assert_array_equal(tension(SQUARE, line, UV, line, SQUARE * 7)[0], 1)


def test_a_collapse_has_ratio_zero():
    for model in MODELS:
        np.testing.assert_array_equal(model(SQUARE, FACES, UV, FACES, SQUARE * 0)[0], 0)
